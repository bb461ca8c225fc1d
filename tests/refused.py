"""What a call says when it refuses."""

import pytest


def refusal(error, call, *arguments, **options) -> str:
    """The words of the error that a call must raise."""
    with pytest.raises(error) as caught:
        call(*arguments, **options)
    return str(caught.value)


def says(text: str, *parts: object) -> bool:
    """Whether a text has all the parts, in this order."""
    place = 0
    for part in map(str, parts):
        place = text.find(part, place)
        assert place >= 0, f"{part!r} isn't where it should be in {text!r}"
        place += len(part)
    return True
