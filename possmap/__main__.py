"""``python -m possmap``: the same as the command ``possmap``."""

from possmap.cli.main import main

if __name__ == "__main__":
    main()
