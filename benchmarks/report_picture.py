"""docs/report.jpg: the page of a session, as Chromium draws it.

`python -m benchmarks.report_picture SESSION_FOLDER` needs the Debian package `chromium`, which
TAMS itself does not.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np

from tams_app.console.report import PAGE_NAME
from tams_app.errors import SetupError

PICTURE = Path(__file__).resolve().parent.parent / "docs" / "report.jpg"
SIZE = (1240, 1500)  # [px]: the timeline, the stops and the first pictures


def main() -> None:
    browser = shutil.which("chromium")
    if browser is None:
        raise SetupError("there is no chromium: install Debian's package of that name")
    page = (Path(sys.argv[1]) / PAGE_NAME).resolve()
    with tempfile.TemporaryDirectory() as folder:
        shot = Path(folder) / "page.png"
        command = [
            browser,
            "--headless",
            "--no-sandbox",
            "--hide-scrollbars",
            f"--user-data-dir={folder}/profile",
            f"--window-size={SIZE[0]},{SIZE[1]}",
            f"--screenshot={shot}",
            page.as_uri(),
        ]
        subprocess.run(command, check=True, capture_output=True, timeout=120)
        image = np.asarray(cv2.imread(str(shot)), np.uint8)
    cv2.imwrite(str(PICTURE), image, [cv2.IMWRITE_JPEG_QUALITY, 80])


if __name__ == "__main__":
    main()
