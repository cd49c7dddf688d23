"""`python -m voxjax` and the command `voxjax`: what little runs before Ctrl-C is handled."""

import sys


def main() -> int:
    """Run the command that the arguments of the process name, and return its exit code."""
    try:
        # Imported here, because Ctrl-C may come while Python imports.
        from .cli.main import main as run

        return run()
    except KeyboardInterrupt:
        return 130


if __name__ == "__main__":
    sys.exit(main())
