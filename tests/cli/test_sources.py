"""Which files the words of a command line name."""

import os
from pathlib import Path

from lsvision.cli.sources import find_sources


def names(words):
    sources, failures = find_sources([str(word) for word in words])
    return [source.name for source in sources], [str(failure) for failure in failures]


def touch(folder, *files):
    for name in files:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text("1,2\n")


def test_folder_gives_its_profiles_in_natural_order(tmp_path):
    touch(
        tmp_path, "p10.csv", "p2.csv", "p1.TXT", ".p3.csv", "README.md", "p.truth.json", "a/b.csv"
    )
    assert names([tmp_path]) == (["p1.TXT", "p2.csv", "p10.csv"], [])


def test_pattern_reaches_into_folders(tmp_path):
    touch(tmp_path, "a/2.csv", "a/10.csv", "b/1.csv", "b/1.txt")
    assert names([tmp_path / "**" / "*.csv"]) == (["2.csv", "10.csv", "1.csv"], [])


def test_a_folder_below_a_pattern_that_cannot_be_listed_is_reported(tmp_path, monkeypatch):
    touch(tmp_path, "a/1.csv", "b/2.csv", "b/.hidden/3.csv")
    scandir = os.scandir

    def deny(path):
        if Path(path).name in ("b", ".hidden"):
            raise PermissionError(13, "Permission denied", str(path))
        return scandir(path)

    monkeypatch.setattr(os, "scandir", deny)
    assert names([tmp_path / "**" / "*.csv"]) == (
        ["1.csv"],
        [f"{tmp_path / 'b'}: cannot be listed: check its owner and mode"],
    )


def test_order_of_the_words_is_kept_and_a_file_comes_once(tmp_path):
    touch(tmp_path, "a.csv", "b.csv")
    words = [tmp_path / "b.csv", tmp_path / "a.csv", tmp_path, tmp_path / "*.csv"]
    assert names(words) == (["b.csv", "a.csv"], [])


def test_a_link_to_a_file_that_is_read_is_noted(tmp_path, capsys):
    touch(tmp_path, "a.csv")
    (tmp_path / "latest.csv").symlink_to(tmp_path / "a.csv")
    assert names([tmp_path, tmp_path / "a.csv"]) == (["a.csv"], [])
    note = f"{tmp_path}/latest.csv: note: the same file as {tmp_path}/a.csv, read once\n"
    assert capsys.readouterr().err == note


def test_file_is_taken_whatever_its_suffix_and_though_its_name_is_a_pattern(tmp_path):
    touch(tmp_path, "p.measured", "p[1].csv", "p1.csv")
    assert names([tmp_path / "p.measured", tmp_path / "p[1].csv"])[0] == ["p.measured", "p[1].csv"]


def test_an_empty_name_is_not_the_current_folder():
    empty = (
        "expected the name of a file or folder, got an empty one: check that the variable is set"
    )
    assert names([""]) == ([], [empty])


def test_missing_file_is_left_to_the_reader(tmp_path):
    assert names([tmp_path / "absent.csv"]) == (["absent.csv"], [])


def test_word_that_names_nothing_is_a_failure_with_its_remedy(tmp_path):
    touch(tmp_path, "README.md")
    found, (folder, pattern) = names([tmp_path, tmp_path / "*.csv"])
    assert found == []
    assert f"{tmp_path}: no profile in this folder" in folder
    assert "**" in folder
    assert "*.csv: no file matches this pattern" in pattern


def test_columns_that_seem_exchanged_are_told(run, written, pipe):
    remark = "if the columns are exchanged, use --columns 1,0"
    exchanged = written(pipe[:, ::-1])
    assert remark in run("measure", exchanged).stdout
    assert remark not in run("measure", exchanged, "--columns", "1,0").stdout
    assert remark not in run("measure", written(pipe)).stdout
