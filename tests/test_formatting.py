import pytest
from hypothesis import given
from hypothesis import strategies as st

from swim2real.formatting import count, degrees, dollars, duration, listed, mm, number, percent, significant, spread


@given(st.floats(-1e3, 1e3), st.integers(0, 3), st.booleans(), st.booleans())
def test_numbers_are_rounded_and_never_a_negative_zero(value, digits, signed, plain):
    shown = number(value, digits, signed=signed, plain=plain)
    read = float(shown.replace("−", "-"))
    assert read == pytest.approx(value, abs=0.51 * 10**-digits)
    assert not (read == 0 and shown[0] in "+-−")
    assert ("−" if plain else "-") not in shown


@pytest.mark.parametrize(
    ("shown", "expected"),
    [
        (number(None), "–"), (number(float("nan"), plain=True), "n/a"), (percent(None), "–"), (significant(None), "–"),
        (number(0.5, None, signed=True), "+0.5"), (number(-1234.5, None), "−1.23e+03"), (mm(-0.0125), "−12.5"),
        (degrees(1.0, 1), "57.3"), (percent(0.1234), "12.3 %"), (significant(1e-15), "0"), (count(12345), "12,345"),
        (dollars(0.05), "0.0500 USD"), (dollars(12.0), "12.00 USD"), (duration(3.21), "3.2 s"),
        (duration(75), "1 min 15 s"), (duration(7300), "2 h 1 min"), (spread(1.23456, 0.05), "1.235 ± 0.050"),
        (listed("abc"), "a, b and c"), (listed("a"), "a"), (listed(range(20), 2), "0, 1 and 18 more"),
    ],
)  # fmt: skip
def test_what_is_shown(shown, expected):
    assert shown == expected
