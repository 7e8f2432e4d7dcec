"""The report as one page that opens from disk, for a reader who never saw the code."""

from collections.abc import Sequence

import numpy as np

from lsvision.studies.chen_liu_2016.ablation import SECTION_SETTINGS, AblationResult
from lsvision.studies.chen_liu_2016.html import (
    digits,
    figure,
    heading,
    note,
    page,
    paragraph,
)
from lsvision.studies.chen_liu_2016.page_summary import glossary, summary_sections
from lsvision.studies.chen_liu_2016.page_tables import (
    ablation_table,
    error_tables,
    reach_table,
    recognition_table,
    repeatability_table,
    scene_table,
    timing_table,
    trap_table,
)
from lsvision.studies.chen_liu_2016.published_results import PUBLISHED_AXIS_MM, PUBLISHED_BOX_MM
from lsvision.studies.chen_liu_2016.repeatability import POSITION, Repeatability, phi_std_of_axes
from lsvision.studies.chen_liu_2016.report import PaperReport
from lsvision.studies.chen_liu_2016.result_pictures import (
    draw_repeatability,
    draw_scene,
    draw_tables,
)
from lsvision.studies.chen_liu_2016.step_pictures import (
    draw_recognition,
    draw_screening,
    draw_smoothing,
)

MAX_FREE_RATIO = 1.1
"""A variant whose errors all stay below this multiple of the whole chain's costs nothing."""
TITLE = "The paper’s experiments, run again"


def report_page(report: PaperReport) -> str:
    """One self-contained HTML page: pictures inline, nothing fetched.

    Parameters
    ----------
    report : PaperReport
        As from `run_experiments`.
    """
    body = [
        paragraph(
            "Chen and Liu, “Radius and Orientation Measurement for Cylindrical Objects by a "
            "Light Section Sensor”: a line laser draws a line over pipes, the line is cut into "
            "ellipses, and each ellipse gives a pipe’s radius and tilt. This page repeats every "
            "table and figure of it on a simulator, where the truth is known, and says what can "
            "be believed. Every number here was computed when the page was made."
        ),
        *summary_sections(report),
        *glossary(),
        *_tables(report),
        *_times(report),
        *_pictures(report),
        *_repeatability(report),
        *_ablation(report),
        *_traps(report),
        *_how(report),
    ]
    return page(TITLE, body)


def _tables(report: PaperReport) -> list[str]:
    return [
        heading("Tables 1-4: radius, θ and φ"),
        paragraph(
            f"The pipes of the paper, 0.6 mm from point to point, noise {report.noise_mm:g} mm, "
            "each measured many times in five ways. The paper gives its sensor’s resolution, 0.6 × "
            "0.9 mm, and not its noise; 0.1 mm goes with that sensor at 400 mm, where its maker’s "
            "resolution is 0.4 mm. Every way is told the nominal radius, as the "
            "paper’s fit is; only (c) believes it. Way (a) looks at a pipe without anything "
            "around it, which is kind to it: see Table 5."
        ),
        figure(draw_tables(report.rows), "Typical errors by table, on a scale where each line is "
               "ten times the one below. Dots on their grey dash are as good as can be; a red "
               "dash far below the dash beside (b) cannot come from one section."),
        *error_tables(report),
        heading("Which printed figures can one section give?", 3),
        paragraph(
            "The paper prints one measurement of each pipe. One small error proves nothing; four "
            "or six small ones in a row do. The chance below is that of the best possible method "
            "to have errors as small together (chi square of printed error over best possible). "
            "Sections that do: 1 mm apart, 19 of 20 errors below the largest printed, for every "
            "pipe of the table."
        ),
        reach_table(report.reaches),
    ]  # fmt: skip


def _times(report: PaperReport) -> list[str]:
    return [
        heading("Table 5: time"),
        paragraph(
            "Both chains on the same profiles, one after the other, in the run that made this "
            "page; the paper’s own seconds are from its Matlab program. Times change from "
            "machine to machine, their ratio much less. Neither chain is told the radius here."
        ),
        timing_table(report.timings),
        recognition_table(report.timings),
        paragraph(
            "A result counts as a pipe if it rests on the pipe’s points. The paper’s chain cuts a "
            "pipe into several arcs where its window is short (a lone pipe fills a small part of "
            "the line, and a tenth of that is a handful of points), and takes flat things for "
            "huge ellipses."
        ),
    ]


def _pictures(report: PaperReport) -> list[str]:
    scenes = [
        piece
        for number, scene in enumerate(report.scenes)
        for piece in (
            heading(f"{'Figure 14' if number == 0 else f'Figure 15 ({number})'}: "
                    f"{scene.title[0].lower()}{scene.title[1:]}", 3),
            figure(draw_scene(scene, number), "Crosses with a letter are refused: no pipe."),
            scene_table(scene),
        )
    ]  # fmt: skip
    return [
        heading("Figures 5-10: the steps on one example"),
        figure(draw_recognition(report.steps), "Figures 5-7. Above: a welded pair among clutter; "
               "crosses are refused. Below: the paper’s rough identification fits an ellipse to "
               "every window of a tenth of the points and accepts where all residuals stay below "
               "0.9 mm. Flat things pass as well as pipes: a huge ellipse fits every straight "
               "line. So lsvision first looks for spans that curve like a pipe."),
        figure(draw_screening(report.steps), "Figures 8 and 9. Accurate screening: the ellipse "
               "of an arc’s middle part decides which end points stay. The paper’s limit of "
               "0.9 mm lets the first points of a weld bead in; lsvision compares each point "
               "with its own noise, and with what the middle part leaves open there."),
        figure(draw_smoothing(report.steps), "Figure 10. Smoothing y over x bends the steep "
               "flanks, and the flanks are what tells a long axis from a short one. Smoothed "
               "along the arc, as the distance from the screened ellipse, they stay."),
        heading("Figures 14 and 15: welded, among planes, among anything"),
        paragraph("The first random scene of each kind, not a chosen one; ± is lsvision’s own "
                  "one sigma."),
        *scenes,
    ]  # fmt: skip


def _repeatability(report: PaperReport) -> list[str]:
    repeated = report.repeatability
    return [
        heading("Figure 16: the same position again and again"),
        figure(draw_repeatability(repeated), f"Centres of {len(repeated.ellipses)} ellipses of "
               "one pipe (19 mm, θ = φ = 20°), one section each."),
        repeatability_table(repeated),
        note(_on_the_box(repeated, report.noise_mm)),
    ]  # fmt: skip


def _on_the_box(repeated: Repeatability, noise_mm: float) -> str:
    width, height = repeated.box_mm
    of_axes = phi_std_of_axes(PUBLISHED_AXIS_MM / 2, POSITION.radius_mm, 10.0)
    return (
        f"The centres fill a box of {digits(width)} × {digits(height)} mm; the paper’s is "
        f"{PUBLISHED_BOX_MM:g} × {PUBLISHED_BOX_MM:g} mm. At {noise_mm:g} mm noise a section knows "
        "a pipe’s place along the line well and its depth badly: a deeper and wider ellipse fits "
        "almost as well. The best possible method fills the paper’s box at a noise of "
        f"{digits(repeated.noise_of_printed_box_mm)} mm; compare the noise that the printed "
        "angles would take, in the table of what one section can give. And axes that vary by "
        f"{PUBLISHED_AXIS_MM:g} mm, as the paper has them, mean {digits(of_axes)}° in φ at 10° if "
        "19 of 20 stay within and they vary each by itself: not the 0.2° of its Table 3."
    )


def _ablation(report: PaperReport) -> list[str]:
    return [
        heading("What each step is worth"),
        paragraph(
            "Pipes alone, welded and among clutter, with 3 % of the points lost and "
            f"{100 * SECTION_SETTINGS.jump_fraction:.0f} % jumping; every line measures the same "
            "arcs with one thing changed. Errors are in multiples of what the best possible "
            "method has on the same pipe: 1 is ideal, 2 is twice the error. “Typical” is the "
            "middle error, “worst” the one that 19 of 20 stay below; “evaluations” is how often "
            "the iterative fit computes its residuals, on average. "
            "What finding the pipes is worth shows in Table 5: the paper has no candidates."
        ),
        ablation_table(report.costs),
        note(_on_what_is_free(report.costs)),
    ]  # fmt: skip


def _on_what_is_free(costs: Sequence[AblationResult]) -> str:
    whole = np.array([*costs[0].typical, *costs[0].worst])
    free = [
        cost.name
        for cost in costs[1:]
        if (np.array([*cost.typical, *cost.worst]) < MAX_FREE_RATIO * whole).all()
    ]
    named = "; ".join(free) or "nothing"
    return (
        f"Changed or left out at a cost of under {100 * (MAX_FREE_RATIO - 1):.0f} % here: {named}. "
        "lsvision’s rough identification leaves out points beyond the sensor error, also inside "
        "the arc, and smoothing finds the same jumps by its robust weights: one of the two is "
        "needed, not both. Homogenised points only give the initial guess of the fit, which "
        "weighs every point by its error; what they save is in the number of evaluations."
    )


def _traps(report: PaperReport) -> list[str]:
    pieces = [heading("Five traps in the paper’s wording")]
    for number, trap in enumerate(report.traps, 1):
        pieces += [
            heading(f"{number}. {trap.title}", 3),
            paragraph(f"{trap.wording} Here: {trap.ours}"),
            trap_table(trap),
        ]
    return pieces


def _how(report: PaperReport) -> list[str]:
    runs = ", ".join(f"({letter}) {count}" for letter, count in
                     zip("abcde", report.effort.runs.values(), strict=True))  # fmt: skip
    return [
        heading("How this was made"),
        paragraph(
            f"Command: lsvision paper --noise-mm {report.noise_mm:g} (add --full for many more "
            f"runs). Measurements of each pipe: {runs}. Scenes of each condition of Table 5: "
            f"{report.effort.timing_scenes}; of each kind in the ablation: "
            f"{report.effort.ablation_scenes}; measurements of Figure 16: "
            f"{report.effort.repeats}. A typical error from n measurements is itself right to "
            "about 70 % divided by the square root of n. The same command gives the same numbers, "
            "times excepted."
        ),
        paragraph(
            "Simulated: parallel rays 0.6 mm apart, errors along the ray, independent from "
            "point to point and growing with the square of the range; points at more than 70° "
            "of incidence are lost. Table 5, Figures 5-15 and the ablation have a fan of rays, "
            "lost points and jumps on top. The simulator shares no code with what is on trial."
        ),
    ]
