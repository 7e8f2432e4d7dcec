"""What a job states and no command uses is reported, not ignored."""

import pytest

from lsvision.errors import InvalidJob
from lsvision.inspection.job import Job
from lsvision.inspection.job_tables import Measure, Rig
from lsvision.inspection.unused_keys import describe_rejected_keys, describe_unused_keys

PART = '[[part]]\nname = "tube"\norder = 1\nradius_mm = { max = 21 }\n'
SCAN = "[scan]\nfeed = [0, 0, 1]\nstep_mm = 1\n"
POSES = 'poses = "poses.csv"\nconvention = "kuka"\n'
LIVE = '[source]\nkind = "folder"\npath = "incoming"\n[output]\nresults = "results"\n'


def note_on(tables):
    return describe_unused_keys(Job.from_text(f'name = "tube"\n{tables}{PART}'))


@pytest.mark.parametrize(
    ("tables", "words"),
    [
        (LIVE, ["[source], [output]", "unattended"]),
        ('[output]\nrecord = "recording"\n', ["[output]", "unattended"]),
        (f"[rig]\n{POSES}", ["poses, convention of [rig]", "[scan]"]),
        ('[rig]\nflange_from_section = "h.json"\n', ["flange_from_section of [rig]", "[scan]"]),
        (f"{SCAN}[measure]\nknown_phi_deg = 0\n", ["known_phi_deg of [measure]", "scan"]),
        ("[measure]\nreference_range_mm = 9\n", ["reference_range_mm of [measure]", "range_std"]),
        ("[decision]\nextra_std = { phi_deg = 1 }\n", ["extra_std of phi_deg", "nothing limits"]),
    ],
)
def test_a_table_or_key_that_nothing_uses_is_named_with_the_reason(tables, words):
    note = note_on(tables)
    assert all(word in note for word in words), note
    assert "\n" not in note


@pytest.mark.parametrize(
    "tables",
    [
        "",
        "[measure]\nknown_phi_deg = 0\n",
        "[measure]\nrange_std_mm = 0.05\nreference_range_mm = 300\n",
        f"[rig]\n{POSES}{SCAN}",
        '[rig]\nlight_section = "rig.json"\nlaser = "red"\n',
        "[decision]\nextra_std = { radius_mm = 0.1 }\n",
    ],
)
def test_a_job_whose_keys_are_all_used_gives_no_note(tables):
    assert note_on(tables) is None


@pytest.mark.parametrize(
    ("tables", "part", "words"),
    [
        ("", "bow_mm = { max = 1 }", "bow_mm of part 'tube' (for scans: add [scan])"),
        ("", "x_mm = [0, 1]\nz_mm = [0, 1]", "z_mm of part 'tube' (for scans: add [scan])"),
        (SCAN, "phi_deg = { max = 1 }", "phi_deg of part 'tube' (for profiles: leave it out"),
        (SCAN, "known_radius_mm = 19", "known_radius_mm of part 'tube' (for profiles"),
        (f"{SCAN}[rig]\n{POSES}", "", "feed of [scan] beside poses of [rig] (leave one out)"),
        ("[scan]\n", "", "[scan] without feed and step_mm, or poses of [rig] (add them)"),
    ],
)
def test_what_a_run_rejects_is_named_before(tables, part, words):
    text = f'name = "tube"\n{tables}{PART}{part}\n'
    note = describe_rejected_keys(
        Job.from_text(text.replace("order = 1\n", "") if "x_mm" in part else text)
    )
    assert note is not None
    assert note.startswith("rejected by inspect: ")
    assert words in note


@pytest.mark.parametrize("tables", ["", SCAN, f"[scan]\n[rig]\n{POSES}"])
def test_a_job_that_a_run_takes_gives_no_note_on_rejections(tables):
    assert describe_rejected_keys(Job.from_text(f'name = "tube"\n{tables}{PART}')) is None


def test_a_direction_for_flush_is_of_a_scan():
    relation = (
        '[[part]]\nname = "b"\norder = 2\nradius_mm = { max = 9 }\n'
        '[[relation]]\nbetween = ["tube", "b"]\nup = [0, 1, 0]\nflush_mm = { max = 1 }\n'
    )
    assert note_on(relation) == "not used: up of [[relation]] (of a scan: add [scan])"
    assert note_on(SCAN + relation) is None


def test_a_reference_from_which_nothing_is_measured_is_named():
    part = (
        '[[part]]\nname = "b"\norder = 2\nnominal_direction = [0, 0, 1]\n'
        "nominal_point_mm = [0, 0, 0]\npoint_y_mm = { max = 1 }\n"
    )
    relation = '[[relation]]\nbetween = ["tube", "b"]\nup = [0, 1, 0]\ngap_mm = { max = 1 }\n'
    assert note_on(SCAN + part + relation) == (
        "not used: nominal_direction of part 'b', up of tube - b (of quantities that nothing "
        "limits)"
    )
    assert note_on(SCAN + part + "direction_deg = { max = 1 }\n") is None


def test_both_reasons_are_in_one_line():
    note = note_on(f'{LIVE}[rig]\nposes = "poses.csv"\n')
    assert "[source], [output]" in note
    assert "poses of [rig]" in note


@pytest.mark.parametrize(
    ("rig", "words"),
    [
        ('light_section_sha256 = "00"', "light_section_sha256 without light_section"),
        ('flange_from_section_sha256 = "00"', "flange_from_section_sha256 without flange_from"),
        ('laser = "red"', "laser without light_section"),
    ],
)
def test_a_key_of_the_rig_without_its_file_is_a_mistake(rig, words):
    with pytest.raises(InvalidJob, match=words):
        note_on(f"[rig]\n{rig}\n")


def test_no_new_key_of_rig_or_measure_goes_unnoticed():
    """A key that is added here is used by `inspect`, or is added to the keys that are reported."""
    assert set(Rig.model_fields) == {
        "light_section", "light_section_sha256", "laser", "flange_from_section",
        "flange_from_section_sha256", "poses", "convention",
    }  # fmt: skip
    assert set(Measure.model_fields) == {
        "radius_mm", "known_radius_mm", "known_phi_deg", "sensor", "range_std_mm",
        "reference_range_mm",
    }  # fmt: skip
