from pathlib import Path

import pytest
from heavy_tables import write_tables


@pytest.fixture(scope="package")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_tables(tmp_path_factory.mktemp("heavy"))
