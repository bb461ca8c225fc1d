"""What `import swim2real` offers."""

import inspect
import subprocess
import sys

import pytest

import swim2real
from recorded import PENDULUM, pendulum_reference
from swim2real.robots.fish import FISH


@pytest.mark.parametrize("name", swim2real.__all__)
def test_every_name_is_there_and_says_what_it_is(name):
    assert inspect.getdoc(getattr(swim2real, name))
    assert name in dir(swim2real)


def test_the_names_are_sorted_and_others_are_refused():
    assert swim2real.__all__ == sorted(swim2real.__all__)
    with pytest.raises(AttributeError, match="attribute robot_from_file"):
        swim2real.robot_from_file  # noqa: B018


def test_importing_it_imports_nothing_else():
    code = "import sys, swim2real; print(*[m for m in sys.modules if m.startswith('swim2real.') or m == 'numpy'])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout.strip()) == (0, "")


def test_a_run_and_swims_from_settings_to_what_they_leave(tmp_path):
    reference = pendulum_reference(1e-3)
    settings = swim2real.CalibrationSettings(method="random", budget=3, threads=1)
    outcome = swim2real.calibrate(reference, PENDULUM, settings, tmp_path / "run", on_warning=None)
    assert isinstance(outcome, swim2real.Outcome)
    compared = swim2real.evaluate(PENDULUM.space.published, reference, PENDULUM)
    assert isinstance(compared, swim2real.Comparison)
    assert compared.loss > 0
    (swim,) = swim2real.simulate(FISH.space.published, FISH, [1.5], seconds=0.1, from_rest=True, threads=1)
    assert swim.track.frame_count == 7
