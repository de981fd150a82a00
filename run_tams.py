#!/usr/bin/env python3
"""The entry of TAMS; everything else is in tams_app."""

import sys

if __name__ == "__main__":
    try:
        from tams_app.cli import main  # takes a second, in which Ctrl-C counts too
    except KeyboardInterrupt:
        print("tams: interrupted", file=sys.stderr)  # noqa: T201
        sys.exit(130)
    main()
