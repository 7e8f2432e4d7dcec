"""Poses from robot programs, from one file each, and from columns in any order."""

import numpy as np
import numpy.testing as npt
import pytest

from lsvision.errors import UnreadableFile
from lsvision.io.robot_poses import read_robot_poses

ROWS = [[600.0, 10.5, 400.25, 10.0, -20.0, 175.0], [610.0, -3.0, 380.0, 12.0, -25.0, 170.5]]


FRAMED = "FP={TOOL_NO 1,BASE_NO 0}\nXP={X 9,Y 2,Z 3,A 4,B 5,C 6}\n"
"""A position of a KUKA program, with its tool and base."""


@pytest.fixture
def write(tmp_path):
    def _write(text, name="poses.csv"):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
        return path

    return _write


@pytest.fixture
def expected(write):
    def _expected(convention="kuka"):
        text = "\n".join(",".join(map(str, row)) for row in ROWS)
        return read_robot_poses(write(text, "plain.txt"), convention)

    return _expected


def assert_same(poses, expected):
    assert len(poses) == len(expected)
    for pose, other in zip(poses, expected, strict=True):
        npt.assert_allclose(pose.matrix, other.matrix, atol=1e-9)


KUKA = [
    "DECL E6POS XP{n}={{X {0},Y {1},Z {2},A {3},B {4},C {5},S 6,T 27,E1 0.0,E2 0.0}}",
    "DECL POS XP{n}={{X {0},Y {1},Z {2},A {3},B {4},C {5},S 'B110',T 2}}",
    "FRAME F{n}={{FRAME: X {0}, Y {1}, Z {2}, A {3}, B {4}, C {5}}}",
    "{{C {5},B {4}}} ;no position\nxp{n}={{x {0},y {1},z {2},c {5},b {4},a {3}}}",
    "PTP {{E6POS: X {0}, Y {1}, Z {2}, A {3}, B {4}, C {5}}} ; point {n}",
    "; LIN {{X 1,Y 2,Z 3,A 4,B 5,C 6}}\nPTP {{X {0},Y {1},Z {2},A {3},B {4},C {5}}} ; was {{X 7}}",
]


@pytest.mark.parametrize("form", KUKA)
def test_positions_of_a_kuka_program(write, expected, form):
    lines = [
        "&ACCESS RVP",
        "DEFDAT scan PUBLIC",
        "DECL FDAT FP1={TOOL_NO 1,BASE_NO 0}",
    ]
    lines += [form.format(*row, n=n) for n, row in enumerate(ROWS)] + ["ENDDAT"]
    path = write("\n".join(lines), "scan.dat")
    assert_same(read_robot_poses(path, "kuka"), expected())
    for other in ("fanuc", "mitsubishi", "matrix"):
        with pytest.raises(UnreadableFile, match=r"KUKA program.*use --convention kuka"):
            read_robot_poses(path, other)


def fanuc(rows, frame="0"):
    text = "/PROG SCAN\n/MN\n 1:L P[1] 100mm/sec FINE ;\n/POS\n"
    for number, (x, y, z, w, p, r) in enumerate(rows, 1):
        name = f'{number}:"view"' if number == 1 else number
        text += f"P[{name}]{{\n   GP1:\n\tUF : {frame}, UT : 1,\tCONFIG : 'N U T, 0, 0, 0',\n"
        text += f"\tX = {x:9.3f}  mm,\tY = {y:9.3f}  mm,\tZ = {z:9.3f}  mm,\n"
        text += f"\tW = {w:9.3f} deg,\tP = {p:9.3f} deg,\tR = {r:9.3f} deg\n}};\n"
    return text + "/END\n"


def test_positions_of_a_fanuc_listing(write, expected):
    path = write(fanuc(ROWS), "SCAN.LS")
    assert_same(read_robot_poses(path, "fanuc"), expected("fanuc"))
    with pytest.raises(UnreadableFile, match=r"FANUC program.*use --convention fanuc"):
        read_robot_poses(path, "kuka")


@pytest.mark.parametrize(
    ("text", "convention", "message"),
    [
        ("DECL E6AXIS XP1={A1 0,A2 -90,A3 90,A4 0,A5 0,A6 0}", "kuka", "joint angles"),
        (fanuc(ROWS[:1]) + fanuc(ROWS[1:], "2"), "fanuc", "several user frames"),
        (fanuc(ROWS[:1]) + fanuc(ROWS).replace("UT : 1", "UT : 2"), "fanuc", "several tools"),
        (fanuc(ROWS).replace("deg\n}", "deg\n GP2:\n X = 5 mm,\n}"), "fanuc", "X occurs twice"),
        (fanuc(ROWS).replace("10.500", "********"), "fanuc", r"P\[1\]: Y is .*never taught"),
        ("P[1]{\n J1= 0.0 deg, J2 = 5 deg\n};", "fanuc", r"P\[1\]: no x y z w p r in it"),
        ("P[1]{X = 1 in, Y = 1 mm, Z = 1 mm}", "fanuc", r"P\[1\]: expected X in mm, got in"),
        ("xp={X 1,Y 2,Z 3,A 4,B 5}", "kuka", "position 1: no c in it"),
        (
            FRAMED + FRAMED.replace("TOOL_NO 1", "TOOL_NO 2"),
            "kuka",
            r"several tools \(TOOL_NO 1, 2\)",
        ),
        (FRAMED + FRAMED.replace("BASE_NO 0", "BASE_NO 3"), "kuka", "several bases"),
    ],
)
def test_what_is_no_position_is_rejected(write, text, convention, message):
    with pytest.raises(UnreadableFile, match=message):
        read_robot_poses(write(text, "p.ls"), convention)


def test_system_variables_of_a_kuka_program_are_no_positions(write, expected):
    form = "XP={{X {},Y {},Z {},A {},B {},C {}}}"
    text = "$TOOL={X 0,Y 0,Z 120,A 0,B 0,C 0}\n" + "\n".join(form.format(*row) for row in ROWS)
    assert_same(read_robot_poses(write(text, "scan.src"), "kuka"), expected())


@pytest.mark.parametrize("head", ["", "X [mm]\tY [mm]\tZ [mm]\tA [deg]\tB [deg]\tC [deg]\n"])
@pytest.mark.parametrize("decimals", ["{}", "{:g}"])
def test_decimal_commas_between_tabs(write, expected, head, decimals):
    lines = ["\t".join(map(decimals.format, row)).replace(".", ",") for row in ROWS]
    path = write(head + "\n".join(lines), "poses.txt")
    assert_same(read_robot_poses(path, "kuka"), expected())


@pytest.mark.parametrize("pattern", ["poses/*.txt", "poses", "poses/pose_?*.txt"])
def test_one_file_a_pose_in_natural_order(write, tmp_path, expected, pattern):
    for number, row in zip((10, 2), reversed(ROWS), strict=True):
        write(" ".join(map(str, row)) + "\n", f"poses/pose_{number}.txt")
    assert_same(read_robot_poses(tmp_path / pattern, "kuka"), expected())


def test_a_file_of_two_poses_among_others_and_a_pattern_of_none_are_rejected(write, tmp_path):
    write("1 2 3 4 5 6\n", "poses/a.txt")
    write("1 2 3 4 5 6\n600 2 3 4 5 6\n", "poses/b.txt")
    with pytest.raises(UnreadableFile, match=r"b.txt: expected one pose in each of 2 files, got 2"):
        read_robot_poses(tmp_path / "poses", "kuka")
    with pytest.raises(UnreadableFile, match="no file of poses there"):
        read_robot_poses(tmp_path / "*.none", "kuka")


@pytest.mark.parametrize("order", ["xyzabc", "zyxcba", "abcxyz", "xaybzc"])
@pytest.mark.parametrize("form", ["{}", "{} ", "{}_", "pos", "#", "upper"])
def test_columns_are_taken_by_their_names(write, expected, order, form):
    place = dict(zip("xyzabc", range(6), strict=True))
    units = dict.fromkeys("xyz", "mm") | dict.fromkeys("abc", "deg")
    names = list(order)
    if form == "upper":
        names = [f"{name.upper()} [{units[name]}]" for name in order]
    if form == "{}_":
        names = [f"{name}_{units[name]}" for name in order]
    if form == "pos":
        names = [f"pos_{name}" if name in "xyz" else name for name in order]
    head = ("# " if form == "#" else "") + ",".join(["time", *names] if form != "#" else names)
    rows = [[row[place[name]] for name in order] for row in ROWS]
    lines = [",".join(map(str, row if form == "#" else [7, *row])) for row in rows]
    assert_same(read_robot_poses(write("\n".join([head, *lines])), "kuka"), expected())


def test_units_in_the_header_count(write, expected):
    rows = [[*(np.array(row[:3]) / 1000), *np.radians(row[3:])] for row in ROWS]
    lines = [",".join(map(str, row)) for row in rows]
    head = "X [m],Y [m],Z [m],A [rad],B [rad],C [rad]"
    assert_same(read_robot_poses(write("\n".join([head, *lines])), "kuka"), expected())
    head = "# all values in m\nx,y,z,a [rad],b [rad],c [rad]"
    assert_same(read_robot_poses(write("\n".join([head, *lines])), "kuka"), expected())


@pytest.mark.parametrize("suffix", ["json", "yaml"])
def test_the_unit_beside_a_list_of_poses_counts(write, expected, suffix):
    rows = [[*(np.array(row[:3]) / 1000).tolist(), *row[3:]] for row in ROWS]
    text = f'{{"unit": "m", "robot": "cell 3", "poses": {rows}}}'
    assert_same(read_robot_poses(write(text, f"poses.{suffix}"), "kuka"), expected())
    with pytest.raises(UnreadableFile, match="lengths in cm: expected all in mm, or all in m"):
        read_robot_poses(write(text.replace('"m"', '"cm"'), f"poses.{suffix}"), "kuka")


def test_units_of_columns_with_other_names_count(write, expected):
    rows = [[*(np.array(row[:3]) / 1000), *np.radians(row[3:])] for row in ROWS]
    lines = [",".join(map(str, row)) for row in rows]
    head = "x [m],y [m],z [m],alpha [rad],beta [rad],gamma [rad]"
    assert_same(read_robot_poses(write("\n".join([head, *lines])), "kuka"), expected())


@pytest.mark.parametrize(
    ("head", "message"),
    [
        ("x,y,z,rx,ry,rz", "names x y z rx ry rz and not a b c of convention 'kuka'"),
        ("x,y,z,w,p,r", "check the convention"),
        ("z,y,x,q,q,q", "check the convention"),
        ("x,x,y,z,a,b,c", "names x 2 times"),
        ("x [in],y [in],z [in],a,b,c", "lengths in in: expected all in mm, or all in m"),
        ("x [mm],y [m],z [m],a,b,c", "lengths in m, mm"),
        ("x [cm],y [cm],z [cm],alpha,beta,gamma", "lengths in cm: expected all in mm"),
        ("x,y,z,a [grad],b [rad],c", "angles in grad, rad"),
    ],
)
def test_a_header_that_says_something_else_is_rejected(write, head, message):
    count = head.count(",") + 1
    lines = [",".join(map(str, [*row, 0.5][:count])) for row in ROWS]
    with pytest.raises(UnreadableFile, match=message):
        read_robot_poses(write("\n".join([head, *lines])), "kuka")


def test_a_quaternion_is_read_by_name_in_any_order(write):
    text = "qw,qx,qy,qz,x,y,z\n0.5,0.5,0.5,0.5,100,200,300\n1,0,0,0,100,200,400\n"
    first, _ = read_robot_poses(write(text), "abb")
    npt.assert_allclose(first.apply_one([1.0, 0, 0]), [100, 201, 300])


def test_poses_as_universal_robots_write_them(write):
    rows = [[0.6, 0.01, 0.4, 0.1, -2.0, 1.1], [0.61, -0.03, 0.38, 0.2, -1.9, 1.0]]
    plain = "\n".join(", ".join(map(str, row)) for row in rows)
    marked = "\n".join(f"p[{', '.join(map(str, row))}]" for row in rows)
    expected = read_robot_poses(write(plain, "plain.txt"), "ur")
    assert_same(read_robot_poses(write(marked, "marked.txt"), "ur"), expected)


@pytest.mark.parametrize(
    "head",
    [
        "X [millimetre],Y [mm],Z [Millimeter],A [deg],B [deg],C [deg]",
        "# x y z in mm, everything in deg",
        "# all in deg",
    ],
)
def test_units_in_words_and_units_of_angles_are_understood(write, expected, head):
    lines = [",".join(map(str, row)) for row in ROWS]
    assert_same(read_robot_poses(write("\n".join([head, *lines])), "kuka"), expected())


def test_brackets_around_cells_with_semicolons_are_ignored(write, expected):
    lines = ["[" + ";".join(str(cell).replace(".", ",") for cell in row) + "]" for row in ROWS]
    assert_same(read_robot_poses(write("\n".join(lines)), "kuka"), expected())


def test_angles_of_a_program_are_in_degrees_however_small(write):
    text = "{X 300, Y 0, Z 0, A 2, B 0, C 0}\n{X 350, Y 0, Z 0, A 3, B 0, C 0}\n"
    poses = read_robot_poses(write(text), "kuka")
    assert poses[1].rotation[1, 0] == pytest.approx(np.sin(np.radians(3)))


ROBTARGET = "CONST robtarget p{n}:=[[{0},{1},{2}],[{3},{4},{5},{6}],[0,-1,0,0],[9E+09,9E9]];"
QUATERNIONS = [[600.0, 10.5, 400.25, 1, 0, 0, 0], [610.0, -3.0, 380.0, 0.6, 0.0, -0.8, 0.0]]


def test_targets_of_an_abb_program_without_its_tools(write):
    lines = ["PERS tooldata t:=[TRUE,[[0,0,100],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];"]
    lines += [ROBTARGET.format(*row, n=n) for n, row in enumerate(QUATERNIONS)]
    lines += ["! " + lines[-1], r"MoveL p0,v100,fine,t\WObj:=wobj0;"]
    plain = "\n".join(" ".join(map(str, row)) for row in QUATERNIONS)
    path = write("\n".join(lines), "scan.mod")
    assert_same(read_robot_poses(path, "abb"), read_robot_poses(write(plain, "p.txt"), "abb"))
    with pytest.raises(UnreadableFile, match="use --convention abb"):
        read_robot_poses(path, "ros")
    path = write("\n".join([*lines, r"MoveL p1,v100,fine,t\WObj:=left;"]), "scan.mod")
    with pytest.raises(UnreadableFile, match=r"several work objects \(WObj wobj0, left\)"):
        read_robot_poses(path, "abb")


@pytest.mark.parametrize(
    "form",
    [
        "P{n}=({0:+.2f},{1:+.2f},{2:+.2f},{3:+.2f},{4:+.2f},{5:+.2f})(7,0) ' P9=(1,2,3,4,5,6)(7,0)",
        "DEF POS P{n}=({0},{1},{2},{3},{4},{5},0.00,0.00)(6,-1048576)",
    ],
)
def test_positions_of_a_mitsubishi_program(write, expected, form):
    path = write("\n".join(form.format(*row, n=n) for n, row in enumerate(ROWS)), "scan.prg")
    assert_same(read_robot_poses(path, "mitsubishi"), expected("mitsubishi"))


YASKAWA = """/JOB
//NAME SCAN
//POS
///NPOS 2,0,0,0,0,0
///TOOL 0
///POSTYPE BASE
///RECTAN
///RCONF 1,0,0,0,0,0,0,0
C00000={0}
C00001={1}
//INST
///DATE 2026/11/28 02:00
NOP
MOVL C00000 V=100.0
MOVL C00001 V=100.0
END
"""


def test_positions_of_a_yaskawa_job(write, expected):
    first, second = (",".join(f"{cell:.3f}" for cell in row) for row in ROWS)
    text = YASKAWA.format(first, second)
    path = write(text, "scan.jbi")
    assert_same(read_robot_poses(path, "yaskawa"), expected("yaskawa"))
    for other, message in [
        (text.replace("///RECTAN", "///PULSE"), "pulses of the joints .* with ///RECTAN"),
        (text.replace("C00001=", "///TOOL 1\nC00001=", 1), r"of several tools \(TOOL 0, 1\)"),
        (text.replace(",175.000", "", 1).replace(",170.500", "", 1), "2 positions begin in it"),
    ]:
        with pytest.raises(UnreadableFile, match=message):
            read_robot_poses(write(other, "other.jbi"), "yaskawa")
    with pytest.raises(UnreadableFile, match="YASKAWA program, got 'kuka': use --convention yaska"):
        read_robot_poses(path, "kuka")


def test_poses_of_a_ur_script(write):
    rows = [[0.6, 0.01, 0.4, 0.1, -2.0, 1.1], [0.61, -0.03, 0.38, 0.2, -1.9, 1.0]]
    plain = write("\n".join(", ".join(map(str, row)) for row in rows), "plain.txt")
    moves = [f"  movel(p{row}, a=1.2, v=0.25)" for row in rows]
    head = ["def scan():", "  set_tcp(p[0, 0, 0.1, 0, 0, 0])", "  # movel(p[9, 9, 9, 0, 0, 0])"]
    path = write("\n".join([*head, *moves, "end"]), "scan.script")
    assert_same(read_robot_poses(path, "ur"), read_robot_poses(plain, "ur"))
    with pytest.raises(UnreadableFile, match="UR program, got 'ros': use --convention ur"):
        read_robot_poses(path, "ros")
    for more in (
        "movej([0, 1.57, -1.57, 0, 0, 0])",
        "movel(home)",
        f"movec(p{rows[0]}, p{rows[1]})",
    ):
        with pytest.raises(UnreadableFile, match="3 motions in it, and 2 of them to a pose: write"):
            read_robot_poses(write("\n".join([*moves, more])), "ur")
    with pytest.raises(UnreadableFile, match=r"of several tools \(TCP p.*\)"):
        read_robot_poses(write("\n".join([*head, "set_tcp(p[0, 0, 0, 0, 0, 0])", *moves])), "ur")


def test_a_kawasaki_program_is_named_with_a_remedy(write):
    text = ".PROGRAM scan()\n  LMOVE p1\n.END\n.TRANS\np1 600 10.5 400 10 20 30\n.END\n"
    with pytest.raises(UnreadableFile, match=r"a Kawasaki program.*: write X Y Z O A T of its pos"):
        read_robot_poses(write(text, "scan.as"), "kawasaki")


UNITS_OF_ANGLES = [
    "# angles in rad",
    "# position in mm, orientation in radians",
    "% units: mm, rad",
    "# rotation unit: rad",
    "X,Y,Z,A,B,C\nmm,mm,mm,rad,rad,rad",
    "x,y,z,a,b,c\n[mm],[mm],[mm],[rad],[rad],[rad]",
]


@pytest.mark.parametrize("head", UNITS_OF_ANGLES)
def test_the_unit_of_angles_above_the_poses_counts(write, expected, head):
    rows = [[*row[:3], *np.radians(row[3:]).tolist()] for row in ROWS]
    text = "\n".join([head, *(",".join(map(str, row)) for row in rows)])
    assert_same(read_robot_poses(write(text), "kuka"), expected())


@pytest.mark.parametrize(
    "units",
    ['"angle_unit": "rad"', '"units": {"length": "mm", "angle": "rad"}', '"units": ["mm", "rad"]'],
)
def test_the_unit_of_angles_beside_a_list_of_poses_counts(write, expected, units):
    rows = [[*row[:3], *np.radians(row[3:]).tolist()] for row in ROWS]
    path = write(f'{{{units}, "poses": {rows}}}', "poses.json")
    assert_same(read_robot_poses(path, "kuka"), expected())


def test_comments_with_other_angles_state_no_unit(write, expected):
    text = "\n".join(",".join(map(str, row)) for row in ROWS)
    head = "# tilt up to 0.5 rad, 2 deg/s, speed in rad/s, 22 °C\n"
    assert_same(read_robot_poses(write(head + text), "kuka"), expected())
    with pytest.raises(UnreadableFile, match="angles in deg, rad: expected all in deg"):
        read_robot_poses(write("# angles in deg, the tilt in rad\n" + text), "kuka")


@pytest.mark.parametrize(
    "form",
    [
        '"{0}","{1}","{2}","{3}","{4}","{5}"',  # quotes around every cell, as some spreadsheets
        "{0} {1} {2} {3} {4} {5}",
    ],
)
@pytest.mark.parametrize("head", ["", "0,1,2,3,4,5\n"])  # pandas numbers columns without names
def test_quotes_and_numbers_of_columns_are_no_part_of_a_pose(write, expected, form, head):
    text = head + "\n".join(form.format(*row) for row in ROWS)
    assert_same(read_robot_poses(write(text), "kuka"), expected())


def test_a_trajectory_of_the_tum_benchmark(write):
    lines = ["# timestamp tx ty tz qx qy qz qw"]
    lines += [f"{k}.5 0.1 0.{k} 0.3 0 0 0 1" for k in (1, 2)]
    poses = read_robot_poses(write("\n".join(lines), "trajectory.txt"), "ros")
    npt.assert_allclose(poses[1].translation, (100, 200, 300))


@pytest.mark.parametrize(
    "form",
    [
        '{{"position": {0}, "orientation": {1}}}',
        '{{"translation": {0}, "rotation": {1}}}',
        '{{"header": {{"frame_id": "base"}}, "pose": {{"position": {0}, "orientation": {1}}}}}',
    ],
)
def test_messages_of_ros_are_poses(write, form):
    turn = '{"x": 0.6, "y": 0, "z": 0, "w": 0.8}'
    rows = [form.format(f'{{"x": 0.{k}, "y": 0.2, "z": 0.3}}', turn) for k in (1, 2)]
    poses = read_robot_poses(write(f"[{', '.join(rows)}]", "poses.json"), "ros")
    npt.assert_allclose(poses[1].translation, (200, 200, 300))
    npt.assert_allclose(poses[1].rotation[:, 1], (0, 0.28, 0.96))


@pytest.mark.parametrize("name", ["poses.csv", "poses.json"])
def test_a_convention_that_the_file_states_is_compared(write, expected, name):
    text = "# convention: KUKA\n" + "\n".join(",".join(map(str, row)) for row in ROWS)
    if name == "poses.json":
        text = f'{{"convention": "kuka", "poses": {ROWS}}}'
    assert_same(read_robot_poses(write(text, name), "kuka"), expected())
    with pytest.raises(UnreadableFile, match=r"states convention .*not 'fanuc'"):
        read_robot_poses(write(text, name), "fanuc")


@pytest.mark.parametrize(
    ("text", "convention"),
    [
        ("P1=(1,2,300,4,5,6)(7,0)\nP2=(9,2,300,4,5,6)\n", "mitsubishi"),
        ("P1=(1,2,300,4,5,6)(7,0)\nP2=(9,2,300,4,5)(7,0)\n", "mitsubishi"),
        (ROBTARGET.format(*QUATERNIONS[0], n=0) + "\nVAR robtarget p1:=[[1,2,3],q,c,e];", "abb"),
    ],
)
def test_incomplete_positions_of_a_program_are_reported(write, text, convention):
    with pytest.raises(UnreadableFile, match="2 positions begin in it, and 1 are complete"):
        read_robot_poses(write(text, "scan.prg"), convention)


def test_system_variables_of_a_mitsubishi_program_are_no_positions(write, expected):
    form = "P{n}=({},{},{},{},{},{})(,)"
    lines = ["P_TOOL=(0,0,120,0,0,0)(0,0)", "10 P_BASE=(5,0,0,0,0,0)(0,0)"]
    lines += [form.format(*row, n=n) for n, row in enumerate(ROWS)]
    path = write("\n".join(lines), "scan.prg")
    assert_same(read_robot_poses(path, "mitsubishi"), expected("mitsubishi"))
