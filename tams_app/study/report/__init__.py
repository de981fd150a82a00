"""From a study's results to a report: HTML, PDF and the figures."""
