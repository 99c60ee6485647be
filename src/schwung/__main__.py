"""`python -m schwung` is `schwung`."""

from schwung.cli import main

main()
