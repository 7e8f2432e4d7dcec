"""Intersections of rays with solids and scenes, compared with marching along the ray."""

import math

import numpy as np
import pytest

from lsvision.geometry import Cylinder, Pose
from lsvision.simulate import NOTHING, BentTube, Prism, Rays, Scene, Tube

MACHINE = 1e-8  # mm: closed forms at ranges of 500 mm
BISECTED = 1e-6  # mm: where the brute force below stops
DOWN = (0.0, -1.0, 0.0)


def fan(count=61, half_angle=0.25):
    angles = np.linspace(-half_angle, half_angle, count)
    directions = np.column_stack([np.sin(angles), -np.cos(angles), np.zeros(count)])
    return Rays(np.zeros((count, 3)), directions)


def brute_force_entry(inside, origin, direction):
    """First distance at which a ray is inside, by marching and bisection; inf if none."""
    steps = np.arange(200.0, 700.0, 0.05)
    hit = inside(origin + steps[:, None] * direction)
    if not hit.any():
        return math.inf
    low, high = steps[hit.argmax()] - 0.05, steps[hit.argmax()]
    while high - low > BISECTED / 10:
        middle = (low + high) / 2
        if inside((origin + middle * direction)[None])[0]:
            high = middle
        else:
            low = middle
    return high


def assert_same_as_brute_force(solid, inside, rays):
    found = solid.first_hits(rays).distances
    for ray in range(len(found)):
        expected = brute_force_entry(inside, rays.origins[ray], rays.directions[ray])
        if math.isfinite(expected) or math.isfinite(found[ray]):
            assert found[ray] == pytest.approx(expected, abs=BISECTED)


def tilted_cylinder(rng):
    axis = [math.tan(rng.uniform(-0.7, 0.7)), rng.uniform(-0.4, 0.4), 1.0]
    return Cylinder((rng.uniform(-30, 30), rng.uniform(-450, -350), 0.0), axis, rng.uniform(10, 40))


def in_cylinder(cylinder, span):
    def inside(points):
        # |(p - point) x axis| < radius: nothing of the closed form on trial.
        relative = points - cylinder.point
        along = relative @ cylinder.direction
        across = np.linalg.norm(np.cross(relative, cylinder.direction), axis=1)
        return (across < cylinder.radius) & (along > span[0]) & (along < span[1])

    return inside


@pytest.mark.parametrize("seed", range(6))
def test_hits_of_a_tube_agree_with_marching(seed):
    cylinder = tilted_cylinder(np.random.default_rng(seed))
    inside = in_cylinder(cylinder, (-math.inf, math.inf))
    assert_same_as_brute_force(Tube(cylinder), inside, fan(21))


@pytest.mark.parametrize("seed", range(6))
def test_hits_of_a_finite_tube_agree_with_marching(seed):
    rng = np.random.default_rng(seed)
    cylinder, span = tilted_cylinder(rng), (-rng.uniform(0, 15), rng.uniform(0, 15))
    rays = fan(21).transformed(Pose(translation=(0.0, 0.0, 4.0)))
    assert_same_as_brute_force(Tube(cylinder, span), in_cylinder(cylinder, span), rays)


def test_hits_of_a_bent_tube_agree_with_marching():
    pipe = BentTube(15.0, (200.0, -400.0, 3.0), (0.1, 1.0, 0.2), 190.0)

    def inside(points):
        relative = points - pipe.bend_centre
        height = relative @ pipe.bend_normal
        spoke = np.sqrt(np.sum(relative**2, axis=1) - height**2)
        return (spoke - 190.0) ** 2 + height**2 < 15.0**2

    assert_same_as_brute_force(pipe, inside, fan(41))


def test_a_ray_that_starts_inside_a_solid_meets_nothing():
    rays = Rays([[0.0, -400.0, 0.0]] * 2, [[0.0, -1.0, 0.0], [0.0, 0.0, 1.0]])
    bent = BentTube(10.0, (500.0, -400.0, 0.0), (0.0, 1.0, 0.0), 500.0)
    straight = Tube.of(radius=10.0, theta=0.0, phi=0.0, centre=(0.0, -400.0))
    for solid in (straight, bent):
        assert np.isinf(solid.first_hits(rays).distances).all()


def test_a_slightly_bent_tube_agrees_with_its_local_cylinder():
    pipe = BentTube(20.0, (1e6, -400.0, 0.0), (0.0, 1.0, 0.3), 1e6)
    local = pipe.local_cylinder(Pose())
    assert local is not None
    straight = Tube(local).first_hits(fan()).distances
    bent = pipe.first_hits(fan()).distances
    both = np.isfinite(straight) & np.isfinite(bent)
    # Two rays are within 2 deg of grazing, where the march does not arrive.
    assert both.sum() >= np.isfinite(straight).sum() - 2 > 4
    # The sagitta of a bend of 1 km over 20 mm of the axis is 2e-4 mm.
    np.testing.assert_allclose(bent[both], straight[both], rtol=0, atol=1e-3)


@pytest.mark.parametrize("seed", range(5))
def test_points_of_a_tube_lie_on_the_ellipse_of_its_section(seed):
    cylinder = tilted_cylinder(np.random.default_rng(seed))
    rays = fan(201)
    distances = Tube(cylinder).first_hits(rays).distances
    met = np.isfinite(distances)
    points = (distances[met, None] * rays.directions[met])[:, :2]
    section = cylinder.section()
    own = section.to_ellipse_frame(points) / [section.semi_major, section.semi_minor]
    np.testing.assert_allclose(np.hypot(*own.T), 1.0, rtol=0, atol=MACHINE)


def test_normals_are_unit_vectors_across_the_axis_and_towards_the_ray():
    cylinder = tilted_cylinder(np.random.default_rng(3))
    rays = fan(201)
    hits = Tube(cylinder).first_hits(rays)
    normals = hits.normals[np.isfinite(hits.distances)]
    np.testing.assert_allclose(normals @ cylinder.direction, 0.0, rtol=0, atol=MACHINE)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, rtol=0, atol=MACHINE)
    towards = np.einsum("ij,ij->i", normals, rays.directions[np.isfinite(hits.distances)])
    assert (towards < 0).all()


def test_tube_of_has_the_given_section():
    tube = Tube.of(radius=19.0, theta=0.6, phi=0.4, centre=(3.0, -410.0))
    section = tube.cylinder.section()
    assert (section.radius, section.theta, section.phi) == pytest.approx((19.0, 0.6, 0.4))
    assert section.centre == pytest.approx((3.0, -410.0))


def test_hits_of_a_prism_with_oblique_extrusion():
    along = (0.5, -0.3, 1.0)
    prism = Prism([[-30.0, -400.0], [40.0, -420.0]], along)
    rays = fan(31, 0.04).transformed(Pose(translation=(0.0, 0.0, 25.0)))
    hits = prism.first_hits(rays)
    points = rays.origins + hits.distances[:, None] * rays.directions
    normal = np.cross([70.0, -20.0, 0.0], along)
    np.testing.assert_allclose((points - [-30.0, -400.0, 0.0]) @ normal, 0.0, atol=1e-6)
    parallel = np.abs(hits.normals @ normal) / np.linalg.norm(normal)
    np.testing.assert_allclose(parallel, 1.0, rtol=0, atol=MACHINE)


def test_the_nearer_of_two_objects_hides_the_other():
    near = Tube.of(radius=10.0, theta=0.0, phi=0.0, centre=(0.0, -300.0))
    far = Tube.of(radius=30.0, theta=0.0, phi=0.0, centre=(0.0, -400.0))
    rays = Rays([[x, 0.0, 0.0] for x in (0.0, 20.0, 50.0)], [DOWN] * 3)
    for scene, labels in ((Scene((far, near)), [2, 1, -1]), (Scene((near, far)), [1, 2, NOTHING])):
        assert scene.first_hits(rays)[1].tolist() == labels


def test_tubes_are_labelled_from_one_and_other_objects_as_clutter():
    tube = Tube.of(radius=10.0, theta=0.0, phi=0.0, centre=(0.0, -300.0))
    bent = BentTube(10.0, (500.0, -400.0, 0.0), (0.0, 1.0, 0.0), 500.0)
    plate = Prism([[0.0, 0.0], [1.0, 0.0]])
    assert Scene((plate, tube, plate, bent)).labels.tolist() == [0, 1, 0, 2]


def test_a_section_that_misses_the_axis_has_no_local_cylinder():
    tube = Tube(Cylinder((0, -400, 0), (0, 0, 1), 10.0), span=(0.0, 50.0))
    poses = [Pose(translation=(0.0, 0.0, z)) for z in (-1.0, 25.0, 51.0)]
    assert [tube.local_cylinder(pose) is None for pose in poses] == [True, False, True]
    assert Tube(Cylinder((0, -400, 0), (1, 0, 0), 10.0)).local_cylinder(Pose()) is None
    far = Pose(translation=(0.0, 0.0, 900.0))
    assert BentTube(9.0, (500, -400, 0), (0, 1, 0), 500.0).local_cylinder(far) is None
    assert BentTube(9.0, (500, -400, 0), (0, 0, 1), 500.0).local_cylinder(Pose()) is None


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Scene(()), "at least one object"),
        (lambda: Prism([[0.0, 0.0]]), "two finite vertices"),
        (lambda: Prism([[0.0, 0.0], [1.0, math.nan]]), "two finite vertices"),
        (lambda: Prism([[0.0, 0.0], [1.0, 0.0]], (1.0, 0.0, 0.0)), "crosses z = 0"),
        (lambda: Tube(Cylinder((0, 0, 0), (0, 0, 1), 1.0), (2.0, 1.0)), "start < stop"),
        (lambda: BentTube(10.0, (0, 0, 0), (0, 0, 0), 50.0), "non-zero bend_normal"),
        (lambda: BentTube(10.0, (0, 0, 0), (0, 0, 1), 5.0), "0 < radius < bend_radius"),
        (lambda: Rays([[0.0, 0.0, 0.0]], [[0.0, 1.0]]), "directions of shape"),
    ],
)
def test_invalid_solids_raise_errors(make, message):
    with pytest.raises(ValueError, match=message):
        make()


@pytest.mark.parametrize("height", [0.0, 3.0])
def test_a_ray_from_the_axis_of_a_bend_meets_the_bent_tube(height):
    """All points of the bend's circle are equally near there."""
    tube = BentTube(10.0, (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 400.0)
    hits = tube.first_hits(Rays([[0.0, 0.0, height]], [DOWN]))
    assert hits.distances[0] == pytest.approx(400.0 - math.sqrt(100.0 - height**2), abs=BISECTED)
    np.testing.assert_allclose(hits.normals[0, 1] * 10.0, math.sqrt(100.0 - height**2), atol=1e-5)
