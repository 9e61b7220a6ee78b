"""`python -m hlp COMMAND`: the command line where no script `hlp` is on the path."""

from hlp.cli import main

if __name__ == "__main__":
    main()
