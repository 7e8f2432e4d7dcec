"""A short campaign of spoilt inputs, the same ones each time; ``python -m tests.fuzz`` is long."""

import warnings

import pytest

from tests.fuzz.campaign import run_campaign
from tests.fuzz.targets import SHARES
from tests.fuzz.worker import run_input

INPUTS = dict.fromkeys(SHARES, 40) | {
    "scans": 6,
    "measurements": 12,
    "commands": 6,
    "lines": 12,
}


@pytest.mark.parametrize("name", INPUTS)
def test_spoilt_inputs_are_rejected_or_read(name, tmp_path):
    warnings.simplefilter("error")
    # Documented, as in worker.main: random points are of any size, and may hold zeros.
    warnings.filterwarnings("ignore", "expected a profile in mm", UserWarning)
    warnings.filterwarnings("ignore", ".* looks like a marker of lost points", UserWarning)
    for number in range(INPUTS[name]):
        assert run_input(name, number, tmp_path) is None, f"{name} {number}"


def test_a_worker_is_run_and_counted():
    printed = []
    findings = run_campaign(60.0, 1, ["poses"], printed.append, most=20)
    assert findings.wrong == [] == printed
    assert findings.tried == {"poses": 20}


def test_a_worker_that_dies_is_a_finding_and_replaced(monkeypatch):
    from tests.fuzz import campaign

    code = """print('{"begin": 7, "target": "poses"}', flush=True); raise SystemExit(3)"""
    real = campaign.subprocess.Popen

    def dying(command, **options):
        return real([command[0], "-c", code], **options)

    monkeypatch.setattr(campaign.subprocess, "Popen", dying)
    findings = run_campaign(0.5, 1, ["poses"], lambda _: None)
    assert findings.wrong[0] == ("poses", 7, "the process ended with 3")
