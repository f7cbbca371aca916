"""`python -m gcs` is `gcs`."""

from gcs.cli import main

if __name__ == "__main__":
    main()
