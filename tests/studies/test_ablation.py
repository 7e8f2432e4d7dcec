"""Errors with single steps changed or left out."""


def test_the_whole_chain_is_nearly_efficient_and_smoothing_over_x_is_not(ablation):
    costs = {cost.name: cost for cost in ablation}
    whole = costs["every step, as lsvision does it"]
    literal = costs["smoothing y over x, equal weights"]
    assert whole.failed == 0
    assert max(whole.typical) < 2  # a dozen pipes: a median right to 40 %
    assert literal.typical[0] > 3  # radius
    assert all(bad > good for bad, good in zip(literal.typical, whole.typical, strict=True))


def test_smoothing_finds_the_jumps_inside_an_arc(ablation):
    """One point in twenty jumps: left in, they spoil the fit; smoothing leaves them out."""
    costs = {cost.name: cost for cost in ablation}
    whole = costs["every step, as lsvision does it"]
    found = costs["rejection of points inside the arc by rough identification"]
    left_in = costs["that rejection and smoothing"]
    assert found.failed == 0
    assert max(found.typical) < 1.3 * max(whole.typical)
    assert min(left_in.worst) > 3 * max(found.worst)


def test_a_good_initial_guess_saves_evaluations(ablation):
    costs = {cost.name: cost for cost in ablation}
    whole = costs["every step, as lsvision does it"]
    assert 2 < whole.evaluations < costs["homogenising"].evaluations + 0.2  # a dozen pipes
    assert costs["iterative fit: a direct algebraic one instead"].evaluations == 0
