#!/usr/bin/env python3
"""The entry of TAMS; everything else is in tams_app."""

from tams_app.start import main

if __name__ == "__main__":
    main()
