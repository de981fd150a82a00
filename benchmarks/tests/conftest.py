"""What holds for every test of the product holds for those of the benchmarks."""

from tests.conftest import _no_default_timeout, pytest_collection_modifyitems

__all__ = ["_no_default_timeout", "pytest_collection_modifyitems"]
