import subprocess
import sys

import pytest

HEAVY = ("depthai", "onnxruntime", "scipy", "starlette", "click")


@pytest.mark.parametrize("package", ["prismstereo_hw", "prismstereo_calibration", "prismstereo_device", "prismstereo"])
def test_importing_a_package_loads_nothing_heavy(package: str) -> None:
    report = f"import {package}, sys; print(*(name for name in {HEAVY!r} if name in sys.modules))"

    loaded = subprocess.run([sys.executable, "-c", report], capture_output=True, text=True, check=True).stdout.split()

    assert loaded == []


@pytest.mark.parametrize("module", ["prismstereo.driver", "prismstereo.depth", "prismstereo_device.__main__"])
def test_what_runs_on_a_camera_or_receives_from_one_needs_no_solver_and_no_command_line(module: str) -> None:
    solver = "prismstereo_calibration.solving.solve"  # numba itself looks for scipy, so scipy is no sign here
    unwanted = (*(name for name in HEAVY if name != "scipy"), solver)
    report = f"import {module}, sys; print(*(name for name in {unwanted!r} if name in sys.modules))"

    loaded = subprocess.run([sys.executable, "-c", report], capture_output=True, text=True, check=True).stdout.split()

    assert loaded == []


def test_help_takes_less_than_three_tenths_of_a_second_of_processor_time() -> None:
    script = (
        "import resource, subprocess, sys\n"
        "subprocess.run([sys.executable, '-m', 'prismstereo', '--help'], stdout=subprocess.DEVNULL, check=True)\n"
        "used = resource.getrusage(resource.RUSAGE_CHILDREN)\n"
        "print(used.ru_utime + used.ru_stime)\n"
    )

    times = [
        float(subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout)
        for _ in range(3)
    ]

    assert min(times) < 0.3


def test_every_public_name_of_the_package_can_be_had() -> None:
    import prismstereo

    for name in prismstereo.__all__:
        assert getattr(prismstereo, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = prismstereo.nothing
