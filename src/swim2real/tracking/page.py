"""Pages on which a person says where markers are: each one a single HTML file without network or libraries.

A page is a template with `page.css` and `page.js` in it, which all of them share, and with data that its script reads.
"""

from __future__ import annotations

import base64
import html
import json
import re
from collections.abc import Mapping
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Picture

from swim2real.errors import TrackingError
from swim2real.escaping import script_source, visible
from swim2real.store import write_text

Image = NDArray[np.uint8]

_HERE = Path(__file__).parent


def write_page(
    template: Path, path: str | Path, video_name: str, data: Mapping[str, Any], remedy: str, **more: str
) -> Path:  # fmt: skip
    """Writes a page.

    Args:
        template: The template; `@@NAME@@` in it is where a part goes.
        path: Path of the page.
        video_name: Name of the video that it is about.
        data: What its script reads: plain lists, dictionaries, texts and finite numbers.
        remedy: What to do where the page can't be written, without a full stop.
        more: Other parts by name, as they are to stand there.

    Returns:
        The path.

    Raises:
        TrackingError: The page can't be written.
    """
    text = template.read_text(encoding="utf-8")
    for part, file in (("STYLE", "page.css"), ("SHARED", "page.js")):
        text = text.replace(f"@@{part}@@", (_HERE / file).read_text(encoding="utf-8").rstrip())
    script = text[text.rindex("<script>") + len("<script>") : text.rindex("</script>")]
    parts = {
        "SCRIPTS": script_source(script),
        "VIDEO": html.escape(visible(video_name)),
        "DATA": json.dumps(data, allow_nan=False).replace("<", "\\u003c"),
        **more,
    }
    place = Path(path)
    try:
        write_text(place, re.sub("@@([A-Z]+)@@", lambda match: parts[match.group(1)], text))
    except OSError as error:
        raise TrackingError(f"can't write '{place}': {error.strerror or error}; {remedy}") from error
    return place


def jpeg_source(image: Image, quality: int) -> str:
    """A picture as what the `src` of an image can be. Shape (H, W, 3)."""
    buffer = BytesIO()
    # without subsampling a marker's color isn't blurred over its neighbors
    Picture.fromarray(np.ascontiguousarray(image)).save(buffer, "JPEG", quality=quality, subsampling=0)
    return "data:image/jpeg;base64," + base64.b64encode(buffer.getvalue()).decode("ascii")
