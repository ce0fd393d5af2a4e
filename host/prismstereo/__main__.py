"""`python -m prismstereo` is the command line."""

from prismstereo.cli import main

if __name__ == "__main__":
    main()
