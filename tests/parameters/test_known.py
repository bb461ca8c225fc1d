"""How well a parameter is known, by the width of its interval."""

import pytest

from swim2real.parameters.known import known


@pytest.mark.parametrize(
    ("width", "sure", "doubted"),
    [(0.0, "determined", "roughly"), (0.25, "determined", "roughly"), (0.26, "roughly", "roughly"),
     (0.79, "roughly", "roughly"), (0.8, "undetermined", "undetermined"), (1.0, "undetermined", "undetermined")],
)  # fmt: skip
def test_a_narrow_interval_determines_a_parameter_if_the_fit_is_believed(width, sure, doubted):
    assert (known(width), known(width, sure=False)) == (sure, doubted)
