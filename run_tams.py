#!/usr/bin/env python3
"""The entry of TAMS; everything else is in tams_app."""

import sys

if __name__ == "__main__":
    try:
        from tams_app.cli import main  # takes a second, in which Ctrl-C counts too

        main()
    except KeyboardInterrupt:
        sys.exit("tams: interrupted")
