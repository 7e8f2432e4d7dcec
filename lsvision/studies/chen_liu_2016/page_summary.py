"""The verdict of the page, in plain words with its numbers, and what the words mean."""

from lsvision.studies.chen_liu_2016.achievability import SIGNIFICANCE
from lsvision.studies.chen_liu_2016.html import bullets, definitions, digits, heading
from lsvision.studies.chen_liu_2016.methods import Method
from lsvision.studies.chen_liu_2016.report import PaperReport
from lsvision.studies.chen_liu_2016.tables import ErrorStatistics, pool_errors


def summary_sections(report: PaperReport) -> list[str]:
    """Where the method is good, where it is not, and why: pieces of HTML."""
    return [
        heading("In short"),
        heading("Where the method is good", 3),
        bullets(_good(report)),
        heading("Where it is not, and why", 3),
        bullets(_bad(report)),
    ]


def _good(report: PaperReport) -> list[tuple[str, str]]:
    one, known = _pooled(report, "section", 3), _pooled(report, "known", 3)
    two, many = _pooled(report, "two", 3), _pooled(report, "twenty", 3)
    printed = {r.quantity: r.largest_printed for r in report.reaches if r.table == 3}
    pipes = sum(t.pipes for t in report.timings)
    ratio = min(t.ratio for t in report.timings)
    slowest = max(t.section.seconds for t in report.timings)
    return [
        ("Finding pipes among other things.",
         f"Of {pipes} pipes in the scenes of Table 5, alone, welded and among clutter, lsvision "
         f"reports {sum(t.section.found for t in report.timings)} and "
         f"{sum(t.section.false for t in report.timings)} things that are no pipe. The paper’s "
         f"chain, taken literally, reports {sum(t.paper.found for t in report.timings)} of them "
         f"and {sum(t.paper.false for t in report.timings)} things that are none."),
        ("Time.", f"At most {digits(1000 * slowest)} ms a measurement, {ratio:.0f} times faster "
         "than the paper’s chain on the same machine, or more."),
        ("Two sections or more.",
         f"At φ = 10°, two sections 10 mm apart give θ to {digits(two.rms.theta_deg)}° and φ to "
         f"{digits(two.rms.phi_deg)}°, twenty over 20 mm to {digits(many.rms.theta_deg)}° and "
         f"{digits(many.rms.phi_deg)}° (printed errors there: up to {printed['theta_deg']:.2f}° "
         f"and {printed['phi_deg']:.2f}°), and the radius to {digits(two.rms.radius_mm)} mm and "
         f"{digits(many.rms.radius_mm)} mm (printed: up to {printed['radius_mm']:.2f} mm)."),
        ("A known radius.", f"At φ = 10° it brings φ from one section from "
         f"{digits(one.rms.phi_deg)}° to {digits(known.rms.phi_deg)}°."),
    ]  # fmt: skip


def _bad(report: PaperReport) -> list[tuple[str, str]]:
    steep, flat = _pooled(report, "section", 1), _pooled(report, "section", 3)
    paper, welded = _pooled(report, "paper", 1), _pooled(report, "section", 4)
    return [
        ("Angles from one section.",
         f"θ is off by {digits(steep.rms.theta_deg)}° at φ = 30° and by "
         f"{digits(flat.rms.theta_deg)}° at φ = 10° (root mean square), φ by "
         f"{digits(steep.rms.phi_deg)}° and {digits(flat.rms.phi_deg)}°. The best possible method "
         f"has {digits(steep.bound.theta_deg)}° and {digits(flat.bound.theta_deg)}°: it is the "
         "data, not the method. A short arc of a nearly round ellipse does not tell where its "
         "long axis points."),
        ("Welded pairs from one section.",
         f"The radius is off by {digits(welded.rms.radius_mm)} mm, where the best possible, "
         f"which is told what is pipe and what is bead, has {digits(welded.bound.radius_mm)} mm: "
         "a bead runs out so gently that its first points pass for the pipe’s."),
        ("The paper’s printed errors.",
         _beyond_one_section(report)),
        ("The paper’s smoothing, taken literally.",
         f"Its chain is off by {digits(paper.rms.radius_mm)} mm in radius in Table 1, where "
         f"lsvision is off by {digits(steep.rms.radius_mm)} mm and the best possible by "
         f"{digits(steep.bound.radius_mm)} mm."),
        ("What the simulator leaves out.", "Shine, dirt, bent pipes and a sensor that smooths "
         "its line; a real bench is worse than this page."),
    ]  # fmt: skip


def _beyond_one_section(report: PaperReport) -> str:
    beyond = [reach for reach in report.reaches if not reach.reachable]
    if not beyond:
        return f"At {report.noise_mm:g} mm noise one section can give them all."
    needed = [reach.sections_needed for reach in beyond if reach.sections_needed is not None]
    would = f"up to {max(needed)} sections 1 mm apart would do" if needed else "no scan would do"
    quiet = report.repeatability.noise_of_printed_box_mm
    share = quiet / report.noise_mm
    still = sum(reach.chance_at(share) < SIGNIFICANCE for reach in report.reaches)
    return (
        f"Of {len(report.reaches)} groups of them (a quantity of a table) {len(beyond)} are "
        f"smaller than one section can give at {report.noise_mm:g} mm noise, and {still} at "
        f"{digits(quiet)} mm, which is what its Figure 16 would take; {would}. How the paper got "
        "them, its text does not say."
    )


def glossary() -> list[str]:
    """What the words of the page mean: pieces of HTML."""
    return [
        heading("Words"),
        definitions([
            ("Section", "The line that the laser draws: one measurement of the sensor, some "
             "hundred points in one plane."),
            ("φ (phi)", "How far the pipe leans from the normal of the laser plane. At 0° the "
             "section is a circle."),
            ("θ (theta)", "Direction in the laser plane in which it leans: the long axis of the "
             "ellipse."),
            ("Noise", "The sensor’s error of a single point, one sigma (two of three errors are "
             "smaller)."),
            ("Root mean square error", "The typical error: two of three are smaller."),
            ("Best possible", "The Cramer-Rao bound: the smallest typical error that any method "
             "without a bias can have on these points. It follows from geometry and noise alone. "
             "Where it is large (θ at φ = 10°) it is a rough figure: no direction can be off by "
             "more than 90°, so real errors may be smaller."),
        ]),
    ]  # fmt: skip


def _pooled(report: PaperReport, way: Method, table: int) -> ErrorStatistics:
    return pool_errors([row.spreads[way] for row in report.rows if row.printed.table == table])
