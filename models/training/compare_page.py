"""``models compare --report`` as one HTML page: the method to use first, then every table and each method's surface."""

from __future__ import annotations

from html import escape
from pathlib import Path

from models.frames import AXES
from models.pages.document import document, pictures, verdict, write_document
from models.training.compare import LIFT, RPM, Comparison, text

DOTS_PER_INCH = 80


def write_page(directory: Path, result: Comparison, command: str) -> Path:
    """Write ``report.html`` and the picture inside it into ``directory``; ``command``: what to type next."""
    use = result.numbers["use"]
    head = f"Best surrogate of this data set: {use['method']}"
    parts = [
        f"<h1>{escape(head)}</h1>",
        verdict(f"Use {use['method']}.", [f"Next: {command}", f"Why: {use['why']}."]),
        f"<pre>{escape(text(result.numbers))}</pre>",
        pictures([_surfaces(directory / "surfaces.png", result)]),
    ]
    return write_document("--report", directory / "report.html", document(head, parts))


def _surfaces(target: Path, result: Comparison) -> Path:
    """The lift over height and wall distance by every method, the data's places as dots."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5.0, 4.0 * len(result.surfaces)), layout="constrained")
    panels = figure.subplots(len(result.surfaces), 1)
    for panel, (method, lift) in zip(panels, result.surfaces.items(), strict=True):
        filled = panel.contourf(result.grid_d, result.grid_h, lift, 24)
        figure.colorbar(filled, label=f"{AXES[LIFT]} [N]")
        panel.plot(result.places[:, 1], result.places[:, 0], "k.", ms=3)
        panel.set(title=f"{method}, {RPM:g} rpm", xlabel="lip to wall d [m]", ylabel="height h [m]")
    figure.savefig(target, dpi=DOTS_PER_INCH)
    return target
