"""The process in which a model is compiled alone: `python compile_process.py MODEL SECONDS BYTES`.

Its last line is what MuJoCo said, as JSON: an error, or an empty text. It imports nothing but MuJoCo, so it is quick to
start.
"""

import json
import sys
from contextlib import suppress

import mujoco


def limit(seconds: int, size: int) -> None:
    """Limits this process's time [s] and memory [bytes], where the system can; it leaves no memory image behind."""
    try:
        import resource
    except ImportError:  # Windows; the parent's clock is left
        return
    for kind, soft, hard in (
        (resource.RLIMIT_CPU, seconds, seconds + 1), (resource.RLIMIT_AS, size, size), (resource.RLIMIT_CORE, 0, 0),
    ):  # fmt: skip
        with suppress(ValueError, OSError):
            resource.setrlimit(kind, (soft, hard))


def main(path: str, seconds: str, size: str) -> None:
    """Compiles a model and computes its first state."""
    limit(int(seconds), int(size))
    said = ""
    try:
        model = mujoco.MjSpec.from_file(path).compile()
        mujoco.mj_forward(model, mujoco.MjData(model))
    except Exception as caught:
        said = f"{type(caught).__name__}: {caught}"
    sys.stdout.write("\n" + json.dumps(said))


if __name__ == "__main__":
    main(*sys.argv[1:])
