"""The frame: help, version, and what a failure looks like from the shell."""

import os
import pickle
import re
import subprocess
import sys
from functools import partial
from pathlib import Path

import pytest

import lsvision
from lsvision.cli.chunk_results import MeasureTask, measure_task
from lsvision.cli.file_chunk import FileOptions
from lsvision.cli.measure_options import build_measure_function
from lsvision.cli.process_settings import prepare_process
from lsvision.cli.robot_frame import RobotFrame

REPOSITORY = Path(__file__).parents[2]
HEAVY = ("numpy", "scipy", "cv2", "matplotlib", "skimage")


def shell(*words, cwd=REPOSITORY, code=None):
    command = ["-c", code] if code else ["-m", "lsvision", *map(str, words)]
    return subprocess.run(
        [sys.executable, *command], cwd=cwd, capture_output=True, text=True, timeout=60, check=False
    )


def test_help_names_every_command(run):
    result = run("--help")
    assert result.exit_code == 0
    assert all(name in result.stdout for name in ("measure", "plan", "simulate", "--version"))


def test_help_names_what_an_option_takes_not_its_type(run):
    """``--radius MM``, not ``--radius <float>``."""
    words = ["calibrate camera", "calibrate hand-eye poses", "calibrate hand-eye sphere", "demo"]
    words += ["calibrate capture", "calibrate laser-plane", "calibrate target", "job new", "line"]
    words += ["measure", "batch", "inspect", "scan", "plan", "paper", "simulate", "study grr"]
    for command in [*words, "study repeat"]:
        shown = run(*command.split(), "--help").stdout.partition("Options:")[2]
        assert "--help" in shown
        assert not re.search("<(float|int|str|path)", shown), command


def test_help_imports_nothing_heavy():
    code = (
        "import sys; from lsvision.cli.app import app\n"
        "try: app(['measure', '--help'])\n"
        f"except SystemExit: print([m for m in {HEAVY} if m in sys.modules])"
    )
    assert shell(code=code).stdout.splitlines()[-1] == "[]"


def test_measure_imports_only_what_it_needs():
    needless = (
        *("scipy.linalg", "scipy.optimize", "scipy.special", "scipy.sparse", "scipy.ndimage"),
        *("matplotlib", "jinja2", "skimage", "pandas", "pyarrow", "dask", "rosbags", "yaml"),
        *("lsvision.calibration", "lsvision.draw", "lsvision.simulate", "lsvision.studies"),
        *("lsvision.cli.calibrate", "lsvision.cli.scan", "lsvision.scan", "lsvision.planning"),
    )
    code = (
        "import sys; from lsvision.cli.app import app\n"
        "try: app(['measure', 'fixtures/welded_pair.csv'])\n"
        f"except SystemExit: print([m for m in {needless} if m in sys.modules])"
    )
    result = shell(code=code)
    assert "radius mm" in result.stdout
    assert result.stdout.splitlines()[-1] == "[]"


def test_the_process_that_only_hands_out_files_imports_nothing_that_measures_them(tmp_path):
    outputs = ["--csv", str(tmp_path / "o.csv"), "--json", str(tmp_path / "o.json")]
    code = (
        "import sys; from lsvision.cli.app import app\n"
        "files = ['fixtures/welded_pair.csv', 'fixtures/single.csv']\n"
        "if __name__ == '__main__':\n"
        f"    try: app(['measure', *files, '--jobs', '2', *{outputs}])\n"
        "    except SystemExit:\n"
        f"        print([m for m in (*{HEAVY}, 'lsvision.measure') if m in sys.modules])"
    )
    result = shell(code=code)
    assert result.stdout.count("radius mm") == 2
    assert result.stdout.splitlines()[-1] == "[]"


def test_a_process_that_measures_does_not_import_the_command_line():
    """Which takes 50 ms, in each process that `lsvision measure` and `lsvision batch` start."""
    code = (
        "import pickle, sys\n"
        "from pathlib import Path\n"
        "measure, task = pickle.loads(sys.stdin.buffer.read())\n"
        "print(len(measure(task)[0].records[0]['cylinders']))\n"
        "print([m for m in ('typer', 'rich', 'click', 'pydantic') if m in sys.modules])"
    )
    robot_frame = RobotFrame(calibration=None, pose_file=None)
    options = FileOptions(measure_function=build_measure_function("10:40"), robot_frame=robot_frame)
    task = MeasureTask(0, (Path("fixtures/welded_pair.csv"),))
    pickled = pickle.dumps((partial(measure_task, options), task))
    done = subprocess.run(
        [sys.executable, "-c", code], input=pickled, capture_output=True, cwd=REPOSITORY,
        timeout=60, check=False,
    )  # fmt: skip
    assert (done.stdout, done.stderr) == (b"2\n[]\n", b"")


def test_a_process_that_imports_the_script_does_not_import_the_command_line():
    code = "import sys, lsvision.__main__; print('typer' in sys.modules)"
    assert shell(code=code).stdout == "False\n"


def test_a_forked_process_of_measure_imports_nothing_that_was_not_preloaded():
    """What it imports, each process imports again."""
    code = (
        "import lsvision.cli.preloaded, pickle, sys\n"
        "before = set(sys.modules)\n"
        "measure, task = pickle.loads(sys.stdin.buffer.read())\n"
        "print(len(measure(task)[0].records[0]['cylinders']), sorted(set(sys.modules) - before))"
    )
    measure = partial(measure_task, FileOptions(measure_function=build_measure_function("10:40")))
    task = MeasureTask(0, (Path("fixtures/welded_pair.csv"),))
    done = subprocess.run(
        [sys.executable, "-c", code], input=pickle.dumps((measure, task)), capture_output=True,
        cwd=REPOSITORY, timeout=60, check=False,
    )  # fmt: skip
    assert (done.stdout, done.stderr) == (b"2 []\n", b"")


def test_a_command_spends_no_time_on_garbage_or_idle_threads():
    code = (
        "import gc, os, sys\n"
        "phases = []\n"
        "gc.callbacks.append(lambda phase, _: phases.append(phase))\n"
        "from lsvision.cli import main\n"
        "sys.argv[1:] = ['measure', 'fixtures/welded_pair.csv']\n"
        "try: main()\n"
        "except SystemExit: pass\n"
        "print(phases.count('start') < 10, os.environ['OPENBLAS_NUM_THREADS'])\n"
        "assert gc.get_freeze_count() > 10_000\n"  # no collection at the end, either
    )
    assert shell(code=code).stdout.splitlines()[-1] == "True 1"
    kept = {**os.environ, "OPENBLAS_NUM_THREADS": "3"}
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=REPOSITORY, env=kept, capture_output=True, text=True,
        timeout=60, check=True,
    )  # fmt: skip
    assert done.stdout.splitlines()[-1] == "True 3"


@pytest.mark.parametrize(
    ("arguments", "starts"),
    [
        ("measure in --jobs 2", True),
        ("batch in --out o --jobs=16 --radius 10:20", True),
        ("measure in --jobs 1", False),
        ("measure in --jobs -2", False),
        ("measure in --jobs 2x", False),
        ("measure in", False),
        ("measure --jobs", False),
    ],
)
@pytest.mark.skipif(sys.platform != "linux", reason="no fork server")
def test_the_fork_server_is_started_with_several_jobs_only(monkeypatch, arguments, starts):
    started = []
    monkeypatch.setattr("lsvision.batch.process_pool.start_fork_server", started.append)
    monkeypatch.setattr("gc.set_threshold", lambda _: None)
    prepare_process(arguments.split())
    assert started == ["lsvision.cli.preloaded"] * starts


@pytest.mark.skipif(sys.platform == "win32", reason="a shell closes the streams")
def test_closed_streams_are_the_null_device(tmp_path):
    def measure(shell, *words):
        command = ["sh", "-c", shell, "sh", sys.executable, "-m", "lsvision", "measure", *words]
        return subprocess.run(
            command, cwd=REPOSITORY, capture_output=True, text=True, timeout=60, check=False
        )

    path = tmp_path / "o.csv"
    done = measure('"$@" <&- >&- 2>&-', "fixtures/welded_pair.csv", "--csv", str(path))
    assert done.returncode == 0
    assert len(path.read_text().splitlines()) == 3
    assert "-: the file is empty" in measure('"$@" <&-', "-").stderr


def test_version_is_reported(run):
    result = run("--version")
    assert result.exit_code == 0
    assert result.stdout.startswith("lsvision ")


def test_a_file_in_place_of_a_command_is_answered_with_the_command(run, written, pipe):
    path = written(pipe, "a b.csv")
    assert f"To measure it: lsvision measure '{path}'" in run(path).stderr
    assert "To measure it" not in run("none.csv").stderr


@pytest.mark.parametrize("group", ["job", "study", "calibrate", "calibrate hand-eye"])
def test_a_group_without_a_command_shows_its_help_in_lines(run, group):
    result = run(*group.split())
    assert result.exit_code == 2
    assert result.stderr == run(*group.split(), "--help").stdout


def test_no_command_shows_the_help_as_a_usage_error(run):
    result = run()
    assert result.exit_code == 2
    assert "Commands:" in result.output


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("--range-std", "50um"), "'--range-std': expected a number, got '50um'"),
        (("--jobs", "0"), "'--jobs': expected at least 1, got '0'"),
        (("--jobs", "many"), "'--jobs': expected a whole number, got 'many'"),
        (("--surface-std", "-1"), "'--surface-std': expected at least 0, got '-1'"),
    ],
)
def test_number_that_is_none_is_quoted_with_what_was_expected(run, words, expected):
    result = run("measure", "profile.csv", *words)
    assert result.exit_code == 2
    assert expected in " ".join(result.output.split())


@pytest.mark.parametrize("words", [["mesure"], ["measure"], ["measure", "--colour", "x.csv"]])
def test_slip_in_the_words_is_a_usage_error(run, words):
    result = run(*words)
    assert result.exit_code == 2
    assert "Error:" in result.stderr
    assert "Traceback" not in result.output


@pytest.mark.parametrize(
    "words", [["\x1b[31m"], ["measure", "--\x1b[31m"], ["plan", "--radius", "9", "\x1b[31m"]]
)
def test_words_that_are_no_text_are_shown_with_escapes(run, words):
    result = run(*words)
    assert result.exit_code == 2
    assert "\x1b" not in result.output
    assert r"\x1b[31m" in result.output


def test_failure_is_one_line_and_exit_code_1():
    result = shell("simulate", "single", "--out", "/nowhere/at/all")
    assert result.returncode == 1
    assert result.stdout == ""
    (line,) = result.stderr.splitlines()
    assert line.startswith("lsvision: /nowhere/at/all/single_0000.csv: its folder does not exist")


def test_debug_shows_the_traceback_wherever_it_stands(run):
    for words in (["--debug", "simulate", "single"], ["simulate", "single", "--debug"]):
        result = run(*words, "--out", "/nowhere/at/all")
        assert result.exit_code == 1
        assert "Traceback" in result.stderr
        assert result.stderr.splitlines()[-1].startswith("lsvision: /nowhere")


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_a_signal_before_a_command_runs_ends_like_one_during_it():
    code = (
        "import os, signal, lsvision.cli.app\n"
        "class Interrupted:\n"
        "    def __call__(self, **_): os.kill(os.getpid(), signal.SIGTERM)\n"
        "lsvision.cli.app.app = Interrupted()\n"
        "from lsvision.cli import main; main()"
    )
    result = shell(code=code)
    assert (result.returncode, result.stderr) == (130, "")


def test_bug_is_one_line_too():
    code = (
        "import sys; sys.argv = ['lsvision', 'plan', '--radius', '19']\n"
        "import lsvision.planning as planning\n"
        "del planning.plan_section\n"
        "from lsvision.cli import main; main()"
    )
    result = shell(code=code)
    assert result.returncode == 1
    (line,) = result.stderr.splitlines()
    assert line.startswith("lsvision: internal error, ImportError: ")
    assert "--debug shows where" in line


def test_name_that_is_no_text_is_shown_with_escapes(tmp_path):
    code = (
        "import sys; sys.argv = ['lsvision', 'measure', '\\udcff.csv']\n"
        "from lsvision.cli import main; main()"
    )
    result = shell(code=code)
    assert result.returncode == 1
    assert result.stderr == "lsvision: \\xff.csv: no such file: check the name\n"


@pytest.mark.parametrize("jobs", ["1", "2"])
def test_units_that_are_stated_are_not_questioned(tmp_path, jobs):
    rows = "\n".join(f"{k * 6e-4:.5f},-0.4" for k in range(200))
    (tmp_path / "m.csv").write_text(f"x,z\n{rows}\n")
    command = [
        sys.executable,
        "-m",
        "lsvision",
        "measure",
        "m.csv",
        "--units",
        "mm",
        "--jobs",
        jobs,
    ]
    done = subprocess.run(
        command, cwd=tmp_path, capture_output=True, text=True, check=False,
        env={**os.environ, "PYTHONPATH": str(Path(lsvision.__file__).parents[1])},
    )  # fmt: skip
    assert done.returncode == 0
    assert "UserWarning" not in done.stderr
