import pytest

from lsvision.errors import InvalidJob, LsvisionError
from lsvision.inspection.job import Job

GOOD = """\
name = "frame tube"
revision = 3

[measure]
radius_mm = [10, 40]
sensor = "lps36hi"

[[part]]
name = "left"
x_mm = [-40, 0]
known_radius_mm = [19, 0.05]
radius_mm = { nominal = 19, upper = 0.1, lower = -0.1 }
phi_deg = { max = 2 }

[[part]]
name = "right"
x_mm = [0, 40]
diameter_mm = { min = 29.8, max = 30.2 }

[[relation]]
between = ["left", "right"]
gap_mm = { max = 0.5 }

[decision]
level = 0.95
extra_std = { radius_mm = 0.01 }
"""


def mistakes_of(text):
    with pytest.raises(InvalidJob) as failure:
        Job.from_text(text, "job.toml")
    return [str(mistake) for mistake in failure.value.mistakes]


def changed(old, new):
    assert old in GOOD
    return GOOD.replace(old, new)


def test_a_good_job_is_read():
    job = Job.from_text(GOOD)
    left, right = job.parts
    assert left.limits["radius_mm"].ends == pytest.approx((18.9, 19.1))
    assert right.expected_radius == pytest.approx(15)
    assert job.relations[0].limits["gap_mm"].ends[1] == 0.5
    assert (job.extra_std("radius_mm"), job.extra_std("diameter_mm")) == (0.01, 0.02)
    assert job.extra_std("phi_deg") == 0


def test_the_hash_is_that_of_the_content_not_of_the_layout():
    same = changed("level = 0.95\n", "# a comment\n").replace("max = 2 ", "max = 2.0 ")
    assert Job.from_text(GOOD).hash == Job.from_text(same).hash
    assert Job.from_text(GOOD).hash != Job.from_text(changed("max = 2 ", "max = 2.1 ")).hash


@pytest.mark.parametrize(
    ("old", "new", "mistake"),
    [
        ("{ nominal = 19, upper = 0.1, lower = -0.1 }", "{ min = 19.1, max = 18.9 }",
         "line 12: part 1, radius_mm: limits reversed: from 19.1 to 18.9; exchange them"),
        ("{ nominal = 19, upper = 0.1, lower = -0.1 }", "{ nominal = 20, min = 18.9, max = 19.1 }",
         "line 12: part 1, radius_mm: nominal 20 lies outside its limits 18.9 to 19.1"),
        ("{ nominal = 19, upper = 0.1, lower = -0.1 }", "{ nominal = 19, upper = -5 }",
         "line 12: part 1, radius_mm: nominal 19 lies outside its limits -inf to 14"),
        ("{ nominal = 19, upper = 0.1, lower = -0.1 }", "{ nominal = 19 }",
         "line 12: part 1, radius_mm: expected upper and lower beside nominal, or min and max, "
         "got neither"),
        ("{ nominal = 19, upper = 0.1, lower = -0.1 }", "{ upper = 0.1, lower = -0.1 }",
         "line 12: part 1, radius_mm: expected a nominal beside upper and lower, got none"),
        ('sensor = "lps36hi"', "known_phi_deg = [120, 1]",
         "line 4: measure: expected known_phi_deg below 90, got 120"),
        ('sensor = "lps36hi"', "known_phi_deg = [5, 120]",
         "line 4: measure: expected known_phi_deg below 90, got 120"),
        ("x_mm = [0, 40]", "x_mm = [0, 40]\nnominal_point_mm = [0, 1e300, 0]",
         "line 18: part 2, nominal_point_mm 2: expected less than or equal to 1000000000, "
         "got 1e+300"),
        ("[decision]", "[scan]\npose_std_mm = 5000\n[decision]",
         "line 24: scan: expected pose_std_mm up to 1000, got 5000"),
        ("[decision]", "[scan]\nfeed_std_deg = 100\n[decision]",
         "line 24: scan: expected feed_std_deg up to 57.3, got 100"),
        ("{ min = 29.8, max = 30.2 }", "{ min = 30, max = 30 }",
         "line 18: part 2, diameter_mm: expected different limits, got 30 twice"),
        ("x_mm = [0, 40]", "x_mm = [-10, 40]",
         "line 17: 'left' and 'right' select the same cylinder: their windows overlap; separate "
         "the windows"),
        ("x_mm = [0, 40]", "x_mm = [40, 0]",
         "line 15: part 2: x_mm reversed: expected [min, max], got [40.0, 0.0]"),
        ("x_mm = [0, 40]", "x_mm = [0, 40]\norder = 2",
         "line 15: part 2: expected a position (x_mm, y_mm, z_mm) or an order, got both"),
        ('["left", "right"]', '["left", "middle"]',
         "line 21: no part is named 'middle': the parts are 'left', 'right'"),
        ('["left", "right"]', '["left", "left"]', "line 21: expected two parts, got 'left' twice"),
        ("gap_mm = { max = 0.5 }", "",
         "line 20: relation 1: expected a limit among distance_mm, angle_deg, gap_mm, flush_mm, "
         "got none"),
        ("diameter_mm =", "diameter =",
         "line 18: part 2, diameter: the unit is missing: write diameter_mm"),
        ("phi_deg =", "fi_deg =", "line 13: part 1, fi_deg: unknown key: did you mean phi_deg?"),
        ("phi_deg = { max = 2 }", 'phi_deg = { max = "2" }',
         "line 13: part 1, phi_deg, max: expected number, got '2'"),
        ("phi_deg = { max = 2 }", "theta_deg = { max = 2 }",
         "line 8: part 1: theta_deg is periodic: expected both limits, less "
         "than 180 deg apart"),
        ("phi_deg = { max = 2 }", "direction_deg = { max = 2 }",
         "line 8: part 1: direction_deg is measured from nominal_direction: add "
         "nominal_direction"),
        ("phi_deg = { max = 2 }", "nominal_direction = [0, 0, 0]",
         "line 8: part 1: expected a non-zero nominal_direction, got 0, 0, 0"),
        ('sensor = "lps36hi"', 'sensor = "lps36hi"\nrange_std_mm = 0.05',
         "line 4: measure: expected sensor or range_std_mm, got both: leave one out"),
        ('sensor = "lps36hi"', "range_std_mm = 1e-300",
         "line 4: measure: expected range_std from 1e-06 to 1000 mm, got 1e-300"),
        ("[10, 40]", "[40, 10]",
         "line 4: measure: radius_mm reversed: expected [min, max], got [40.0, 10.0]"),
        ("revision = 3", "revision = 3\nschema = 2",
         "line 3: expected schema 1 or older, got 2: install a newer lsvision"),
        ("level = 0.95", "level = 95", "line 25: decision, level: expected less than 1, got 95"),
        ("{ radius_mm = 0.01 }", "{ radius = 0.01 }",
         "line 24: decision: extra_std: expected a key among radius_mm, diameter_mm, theta_deg, "
         "phi_deg, centre_x_mm, centre_y_mm, "
         "direction_deg, position_mm, point_x_mm, point_y_mm, point_z_mm, bow_mm, taper_mm_per_m, "
         "ovality_percent, length_seen_mm, distance_mm, angle_deg, gap_mm, flush_mm, got 'radius'"),
        ('name = "frame tube"\n', "", "name is missing: add it"),
        ('name = "frame tube"', f'name = "{"x" * 81}"',
         f"line 1: name: expected a text of at most 80 characters, got '{'x' * 59}..."),
        ("x_mm = [0, 40]", "x_mm = [0]", "line 17: part 2, x_mm: value 2 is missing: add it"),
        ("x_mm = [0, 40]", "x_mm = [0, 1, 40]",
         "line 17: part 2, x_mm: expected 2 values, got [0, 1, 40]"),
        ("x_mm = [0, 40]", "x_mm = 0", "line 17: part 2, x_mm: expected a list, got 0"),
        ("x_mm = [0, 40]", "x_mm = [0, 40]\nknown_radius_mm = -1",
         "line 18: part 2, known_radius_mm: expected greater than 0, got -1"),
        ("x_mm = [0, 40]", "x_mm = [0, 40]\nknown_radius_mm = [9, -1]",
         "line 18: part 2, known_radius_mm 2: expected greater than or equal to 0, got -1"),
        ("phi_deg = { max = 2 }", "phi_deg = 2",
         "line 13: part 1, phi_deg: expected a table, got 2"),
        ("[decision]", "[scan]\nstep_mm = 1\n[decision]",
         "line 24: scan: expected feed with step_mm, got one alone: add the other"),
        ("[decision]", "[scan]\nfeed = [0, 0, 0]\nstep_mm = 1\n[decision]",
         "line 24: scan: expected a non-zero feed, got 0, 0, 0"),
        ("[decision]", "[scan]\nfeed = [0, 0, 1]\nstep_mm = 0\n[decision]",
         "line 24: scan: expected step_mm other than 0, got 0"),
        ('between = ["left", "right"]\n', "", "line 20: relation 1, between is missing: add it"),
        ("revision = 3", "revision = = 3", "line 2: not TOML: invalid value"),
    ],
)  # fmt: skip
def test_a_mistake_is_named_with_its_line_and_the_remedy(old, new, mistake):
    assert mistakes_of(changed(old, new)) == [mistake]


def test_all_mistakes_are_named_at_once_in_the_order_of_the_lines():
    text = changed("max = 2 ", 'max = "two" ').replace("level = 0.95", "level = 0.2")
    assert [mistake.split(":")[0] for mistake in mistakes_of(text)] == ["line 13", "line 25"]


def test_a_job_without_parts_is_rejected():
    assert mistakes_of('name = "nothing"\npart = []') == [
        "line 2: expected at least one [[part]], got none: add it"
    ]


def job_of_two(names, orders):
    return 'name = "a"\n' + "".join(
        f'[[part]]\nname = "{name}"\norder = {order}\nphi_deg = {{ max = 2 }}\n'
        for name, order in zip(names, orders, strict=True)
    )


def test_two_parts_of_one_order_claim_one_pipe():
    assert mistakes_of(job_of_two("bc", (1, 1))) == [
        "line 8: 'b' and 'c' select the same cylinder, order 1: give each part an order of its own"
    ]


def test_two_parts_of_one_name_are_rejected():
    assert mistakes_of(job_of_two("bb", (1, 2))) == ["line 7: two parts are named 'b': rename one"]


def test_a_part_that_nothing_distinguishes_from_others_is_rejected():
    text = 'name = "a"\n[[part]]\nname = "b"\nphi_deg = { max = 2 }\n'
    assert mistakes_of(text) == [
        "line 2: part 1: expected a way to identify the cylinder, got nothing: add x_mm = [min, "
        "max], order = 1, or a radius_mm with a nominal above 0"
    ]
    text = 'name = "a"\n[[part]]\nname = "b"\nradius_mm = { min = -1, max = 1 }\n'
    assert "identify the cylinder, got a radius of 0 mm: add" in mistakes_of(text)[0]


def test_a_deviation_may_be_of_one_sign_as_in_a_fit():
    job = Job.from_text(changed("upper = 0.1, lower = -0.1", "upper = -0.02, lower = -0.05"))
    assert job.parts[0].radius_mm.ends == pytest.approx((18.95, 18.98))


def test_a_file_is_named_in_the_message(tmp_path):
    path = tmp_path / "job.toml"
    path.write_text('name = "a"')
    with pytest.raises(LsvisionError, match=r"job\.toml: part is missing: add it"):
        Job.load(path)
    with pytest.raises(LsvisionError, match="no such file"):
        Job.load(tmp_path / "none.toml")


def test_a_limit_is_not_compared_with_a_known_radius():
    golden = "\n[golden]\nradius_mm = 19\ntolerance_mm = 0.1\nevery_hours = 8\n"
    text = changed("radius_mm = [10, 40]", "known_radius_mm = [19, 0.05]") + golden
    message = (
        "_mm would be compared with known_radius_mm of [measure], whatever the points say: write "
        "known_radius_mm under [[part]] instead"
    )
    assert mistakes_of(text) == [
        f"line 12: radius{message}",
        f"line 18: diameter{message}",
        f"line 29: radius{message}",
    ]
    only_phi = changed("radius_mm = [10, 40]", "known_radius_mm = [19, 0.05]").replace(
        "radius_mm = { nominal = 19, upper = 0.1, lower = -0.1 }\n", ""
    ).replace("diameter_mm = { min = 29.8, max = 30.2 }\n", "")  # fmt: skip
    assert Job.from_text(only_phi).measure.known_radius_mm == (19, 0.05)
    tilt = changed("radius_mm = [10, 40]", "radius_mm = [10, 40]\nknown_phi_deg = 5").replace(
        "gap_mm", "angle_deg"
    )
    message = "_deg would be compared with known_phi_deg of [measure], whatever the points say: "
    assert mistakes_of(tilt) == [
        f"line 14: phi{message}leave it out", f"line 23: angle{message}leave it out"
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "phi_deg = { max = 2 }", "phi_deg = { min = 95 }",
            "line 13: phi_deg: limits >= 95 hold no possible value: expected some 0 to 90 deg",
        ),
        (
            "gap_mm = { max = 0.5 }", "distance_mm = { max = -0.5 }",
            "line 22: distance_mm: limits <= -0.5 hold no possible value: expected some from 0 mm",
        ),
        (
            "phi_deg = { max = 2 }", "diameter_mm = { min = 21, max = 22 }",
            "line 13: diameter_mm: half of it, 10.5 .. 11, excludes radius_mm 18.9 .. 19.1: "
            "leave one out",
        ),
        (
            "radius_mm = [10, 40]", "radius_mm = [10, 18]",
            "line 12: radius_mm: radius 18.9 .. 19.1 is not searched: radius_mm of [measure] is "
            "10 .. 18",
        ),
        (
            "radius_mm = [10, 40]", "radius_mm = 20",
            "line 18: diameter_mm: radius 14.9 .. 15.1 is not searched: radius_mm of [measure] is "
            "16 .. 24",
        ),
    ],
)  # fmt: skip
def test_limits_that_no_cylinder_can_meet_are_mistakes(old, new, message):
    assert mistakes_of(changed(old, new)) == [message]


def test_limits_may_reach_beyond_the_possible_values():
    text = changed("phi_deg = { max = 2 }", "phi_deg = { nominal = 90, upper = 1, lower = -1 }")
    assert Job.from_text(text).part("left").phi_deg.ends == (89, 91)
