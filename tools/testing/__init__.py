"""Property suites for what you write; `hoap3.testing` is their front door.

Their assertions are rewritten by pytest, as those of a test file are.
"""

import pytest

pytest.register_assert_rewrite(
    *(
        f"{__name__}.{module}"
        for module in ("constraints", "controllers", "plants", "robots", "tasks")
    )
)
