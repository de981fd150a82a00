"""A helper process for tests/video/test_reporting_helper.py: reports what it was given."""

from tams_app.runtime.process import HelperSide
from tams_app.video.live.reporting_helper import line_of, reports_to_session


def main() -> None:
    side = HelperSide()
    with reports_to_session(side.specification, 5.0) as reports:
        for report in side.specification["say"]:
            reports.sendall(line_of(report))
        side.ready(said=len(side.specification["say"]))
        side.stop_requested.wait()


if __name__ == "__main__":
    main()
