"""What people read afterwards: one HTML file, and its pictures.

Nothing is imported here: what a report holds is known without the library that draws it.
"""
