"""`roadfiber locate`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from vision.contract.errors import InputError

if TYPE_CHECKING:
    from solver.drive.drive_run import DriveRun
    from solver.run.run import Run

app = typer.Typer()


@app.command()
def locate(
    site: Annotated[Path, typer.Argument(help="The survey's site.toml, or its folder.")],
    out: Annotated[Path, typer.Option("--out", help="Run folder to write.")] = Path("run"),
    method: Annotated[str, typer.Option(help="spline (default), or network: the paper's.")] = "spline",
    likelihood: Annotated[
        str | None,
        typer.Option(
            help="Of the network: published, or whitened: noise and priors as the spline's.", show_default="published"
        ),
    ] = None,
    effects: Annotated[
        str | None,
        typer.Option(help="Effects in the model, by comma; none: as published.", show_default="the base model's"),
    ] = None,
    filters: Annotated[
        list[str] | None,
        typer.Option("--filter", help="fk or median, for the matched filter in much noise; may be given twice."),
    ] = None,
    all_passes: Annotated[
        bool,
        typer.Option("--all-passes", help="Fit all vehicles; of more than 30, the 10 to 20 that tell most otherwise."),
    ] = False,
    unlisted: Annotated[
        bool,
        typer.Option("--unlisted", help="Fit vehicles, too, that the fiber hears and the trajectories lack."),
    ] = False,
    corridor: Annotated[
        str,
        typer.Option(help="full: with what the model may lack; fit: as if it lacked nothing, which is faster."),
    ] = "full",
    as_json: Annotated[bool, typer.Option("--json", help="Print fit.json instead of words.")] = False,
) -> None:
    """Locate the fiber of a survey: DAS files and trajectories, or a video, to a route on a map.

    Writes route.csv, route.geojson, fit.json and report.html. Where there are no trajectories the video is tracked
    first, and the run folder gets trajectories.csv too.

    The 95 % corridor holds what the model may lack: at the end every effect of the catalogue is tested on what the fit
    leaves, and the corridor widened by how far the route would follow it. `--corridor fit` leaves that out.

    Where site.toml has `[route]`, the operator's map of a fiber that one car with GPS drove along, the clock, loops of
    slack and the place of every channel along that map are found, and whether gauge length, channel spacing and clock
    are as stated; `--effects gauge_length,channel_stretch,clock_drift` fits them. `--method` and the like do not apply.

    Examples: `roadfiber locate surveys/main-street/site.toml --out runs/main-street`, `roadfiber locate drive`
    """
    import roadfiber as rf
    from solver.run.folder import check_target
    from solver.run.locate import EFFECTS

    check_target(out)
    asked = EFFECTS if effects is None else [name.strip() for name in effects.split(",")]
    chosen = [name for name in asked if name not in ("", "none")]
    try:
        run = rf.locate(
            site,
            method=method,
            likelihood=likelihood,
            effects=chosen,
            filters=filters or (),
            all_passes=all_passes,
            unlisted=unlisted,
            corridor=corridor,
        )
    except InputError as error:
        raise InputError(f"{error}{pictured(error, out)}") from error
    run.save(out)
    print((out / "fit.json").read_text(encoding="utf-8") if as_json else summary(run, out))


def pictured(error: InputError, out: Path) -> str:
    """Draw what was seen of a record that is refused, beside the run folder; where, as the end of a sentence."""
    from solver.start.alignment import NotFollowingError
    from vision.contract import writing

    seen = next((one.seen for one in (error, error.__cause__) if isinstance(one, NotFollowingError)), None)
    if seen is None:
        return ""
    path = out.with_name(f"{out.name}-refused.png")
    with writing(path) as temporary:
        seen.figure().savefig(temporary, format="png", dpi=150)
    return f"; what was seen: {path}"


def summary(run: "Run | DriveRun", out: Path) -> str:
    """Say what files state, what was found and how far it may be relied on: what the report and fit.json say, too."""
    from solver.run.run import Run
    from vision.contract.statements import Statements, table_lines

    stated = table_lines([Statements.of(one) for one in run.facts["statements"]])
    if not isinstance(run, Run):
        return "\n".join([*stated, run.headline, run.trust, *run.warnings, f"report: {out / 'report.html'}"])
    known = run.route[run.route["constrained"]]
    found = ["the data decide no place of the fiber"]
    if len(known):
        first, last = known["channel"].iloc[[0, -1]]
        across, deep = known["sigma_y"].max(), known["sigma_z"].max()
        found = [f"fiber located over {len(known)} channels, {first} to {last}"]
        found += [f"1 sigma: {across:.2f} m across at most, {deep:.2f} m in depth"]
    return "\n".join(
        [
            *stated,
            run.headline,
            run.trust.replace("RUN", str(out)),
            *found,
            *([run.corridor.replace("RUN", str(out))] if run.corridor else []),
            *run.warnings,
            f"report: {out / 'report.html'}",
        ]
    )
