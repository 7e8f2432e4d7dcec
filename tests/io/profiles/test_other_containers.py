"""Files that people try but that hold no profile: messages say what they are and what to do."""

import io
import pickle
import zipfile

import pytest

from lsvision.errors import UnreadableFile
from lsvision.io.profiles import read_profile


def zipped(*names):
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for name in names:
            archive.writestr(name, "1,2\n")
    return stream.getvalue()


@pytest.mark.parametrize(
    ("content", "name", "message"),
    [
        (
            zipped("[Content_Types].xml", "xl/workbook.xml"),
            "a.bin",
            "a spreadsheet: save it as CSV",
        ),
        (zipped("a.xml", "b.xml"), "a.xlsx", "a spreadsheet: save it as CSV"),
        (zipped("mimetype", "content.xml"), "a", "an OpenDocument file: save its table"),
        (zipped("word/document.xml"), "a.docx", "a text document: save its table as CSV"),
        (zipped("profile.csv"), "a.zip", "a zip archive of profile.csv: unpack it"),
        (
            zipped(*[f"{k}.csv" for k in range(9)]),
            "a.csv",
            "1.csv, 2.csv and 6 more: unpack",
        ),
        (zipped(), "a.zip", "a zip archive of nothing: unpack it"),
        (b"%PDF-1.7\n", "a.csv", "a PDF: export the numbers as CSV"),
        (b"MATLAB 5.0 MAT-file, Platform", "a.mat", "a MAT file: .*writematrix"),
        (b"MATLAB 7.3 MAT-file", "a.mat", r"a MAT file \(HDF5\): .*writematrix"),
        (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", "a.xls", "an old Office document"),
        (b"7z\xbc\xaf\x27\x1c", "a.7z", "a 7z archive: unpack"),
        (b"SQLite format 3\0", "a.db3", "a database .*: export its points as CSV"),
        (pickle.dumps([1.5], 2), "a.pkl", "a Python pickle, which may run code"),
        (pickle.dumps([1.5], 4), "a.pkl", "a Python pickle, which may run code"),
        (pickle.dumps([1.5], 5), "a.pkl", "a Python pickle, which may run code"),
        (b"solid tube\n facet normal 0 0 1\n", "a.stl", "an STL mesh"),
        (b"ARROW1\0\0", "a.feather", "write it as Parquet"),
        (b"\x89MCAP0\r\n", "a.mcap", "a ROS bag"),
        ("<!DOCTYPE html><html>", "a.csv", "a web page"),
        ("<?xml version='1.0'?><points/>", "a.xml", "a web page or an XML file"),
        ("II*\0rest", "a.tif", "--light-section .* --x0, --dx and --z-unit"),
    ],
)
def test_a_container_is_named_with_the_remedy(write, content, name, message):
    with pytest.raises(UnreadableFile, match=message):
        read_profile(write(content, name))


def test_a_text_that_begins_as_a_container_does_is_text(write):
    assert len(read_profile(write("BMW tube\nx,z\n1,2\n3,4\n"))) == 2
    assert len(read_profile(write("VERSION: 3\nx,z\n1,2\n3,4\n"))) == 2
    assert len(read_profile(write("solid rod, run 3\nx,z\n1,2\n3,4\n"))) == 2


def test_a_remark_that_names_the_sensor_makes_no_log_of_results(write):
    assert len(read_profile(write("# scanCONTROL 2950\nx;z\n1;2\n3;4\n"))) == 2
    assert len(read_profile(write("Micro-Epsilon LLT2950\nx;z\n1;2\n3;4\n"))) == 2
