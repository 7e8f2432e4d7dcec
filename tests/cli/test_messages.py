"""The bar of a long run: how much is done, and what is left."""

import pytest

from lsvision.cli import messages as progress
from lsvision.cli.messages import Progress, format_duration


@pytest.fixture
def shown(monkeypatch, capsys):
    """A function that returns what a bar of four files writes, some seconds after its start."""
    clock = [100.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: clock[0])
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    made = Progress(4)

    def show(seconds, *arguments):
        clock[0] = 100.0 + seconds
        made.show(*arguments)
        return capsys.readouterr().err

    return show


def test_it_tells_what_is_left(shown):
    assert " 1/4, 1 min 30 s left a.csv" in shown(30, 1, "a.csv")
    assert " 1/4, profile 16 of 64, 2 min 12 s left b.npy" in shown(60, 1, "b.npy", 16, 64)


@pytest.mark.parametrize(("seconds", "done"), [(0.5, 1), (9.0, 0), (9.0, 4)])
def test_it_does_not_guess_at_the_start_nor_at_the_end(shown, seconds, done):
    assert "left" not in shown(seconds, done, "a.csv")


@pytest.mark.parametrize(("seconds", "text"), [(4.6, "0 min 05 s"), (7500, "2 h 05 min")])
def test_durations_are_in_words(seconds, text):
    assert format_duration(seconds) == text
