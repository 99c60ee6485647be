"""What Schwung offers to programs: `import schwung` hands it out; command line and service use nothing else.

Every function takes and returns values that show themselves in a notebook (`shown.py`); nothing is imported before it
is asked for.
"""
