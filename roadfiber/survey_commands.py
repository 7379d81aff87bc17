"""`roadfiber simulate` and `roadfiber effects`."""

from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer()


@app.command()
def simulate(
    scenario: Annotated[
        str,
        typer.Argument(help="A TOML file, `street`, `street-` and `short`, `gps`, `paper`, `filtered` ..., or `drive`"),
    ],
    out: Annotated[Path, typer.Option(help="Folder to write; an earlier simulated survey there is replaced.")],
    seed: Annotated[int | None, typer.Option(help="Another seed is another street.  [default: 0]")] = None,
    passes: Annotated[int | None, typer.Option(help="Vehicles that go by.  [default: 8]")] = None,
    snr: Annotated[float | None, typer.Option(help="Signal to noise in the passes' maps, dB.  [default: 20]")] = None,
    laid: Annotated[
        str | None,
        typer.Option(
            help="How the fiber lies: a shape by chance; one, such as `crossing`; or `winding`.  [default: as-built]"
        ),
    ] = None,
    hide: Annotated[
        list[str] | None, typer.Option(help="Hide an effect or set one of its settings, NAME=AMOUNT; may be repeated.")
    ] = None,
    film: Annotated[
        bool, typer.Option("--film", help="Render a video in place of trajectories; of `street-filmed`.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print what was written as JSON.")] = False,
) -> None:
    """Simulate a survey: DAS files, trajectories, anchors, site.toml, and truth.json with all that they hide.

    The generator shares no code with the solver's signal path. The keys of a scenario file are the fields of
    `solver.simulator.Scenario`, such as `speeds = [30, 50]` (km/h) or `[effects]` with `gauge_length = 0.15`; with
    `base = "drive"` those of `solver.simulator.drive_scenario.DriveScenario`, such as `length = 5000` (m).

    Some sixty effects can be hidden in it, see `solver.simulator.EFFECTS`, such as `--hide viscoelastic_lag=0.3
    --hide viscoelastic_lag_tau=0.4`; those whose name begins with `unknown_` are in no catalogue.

    Examples: `roadfiber simulate street --seed 3 --out survey` and then `roadfiber locate survey/site.toml --out run`;
    `roadfiber simulate drive --out drive`
    """
    import json

    import roadfiber as rf
    from solver.simulator import amounts

    hidden = amounts(hide) if hide else None
    made = rf.simulate(out, scenario, seed=seed, passes=passes, snr_db=snr, laid=laid, effects=hidden, film=film)
    if as_json:
        print(json.dumps(made.to_dict()))
        return
    first, last = made.active_channels
    passed = "one pass" if made.passes == 1 else f"{made.passes} passes"
    print(
        f"wrote {made.site}: {passed}, {made.channels} channels, {made.seconds:g} s; "
        f"channels {first} to {last} are in view"
    )


@app.command()
def vehicles(
    site: Annotated[Path, typer.Argument(help="The survey's site.toml, or its folder.")],
    run: Annotated[Path | None, typer.Option(help="A run of this survey: listen to what it leaves, too.")] = None,
    out: Annotated[Path | None, typer.Option(help="Write the list as csv.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of words.")] = False,
) -> None:
    """List the vehicles that the fiber heard, those that the camera saw among them, and compare the clocks.

    The whole record is searched, so that vehicles that nobody listed are found too: time, speed along x, SNR and, where
    it was seen, its track.

    On a busy street vehicles hide each other; a run that `roadfiber locate --unlisted` made takes them apart.

    Example: `roadfiber vehicles surveys/main-street/site.toml --run runs/main-street --out heard.csv`
    """
    import json

    import roadfiber as rf
    from roadfiber.locating import open_street
    from vision.contract import require_writable, writing

    if out is not None:
        require_writable(out)
    found = rf.vehicles(site, None if run is None else open_street(run))
    if out is not None:
        with writing(out) as temporary:
            found.table.to_csv(temporary, index=False)
    if as_json:
        print(json.dumps(found.facts, allow_nan=False, indent=1))
        return
    print(found.headline)
    for row in found.table.to_dict("records"):
        who = f"track {row['track_id']}, {row['late']:+.1f} s" if row["track_id"] else "not in the trajectories"
        print(f"  {row['time']:%H:%M:%S} {3.6 * row['speed']:+4.0f} km/h {row['snr_db']:3.0f} dB  {who}")


@app.command()
def effects(
    name: Annotated[str | None, typer.Argument(help="One effect, in detail.")] = None,
    plugin: Annotated[list[Path] | None, typer.Option(help="Python file with effects of yours; may repeat.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON: a list, or one effect's object.")] = False,
) -> None:
    """List the effects that a model can be given, stage by stage, or verify and show your own.

    Each with its parameters (unit, plausible size, null, bounds, scope), physics, source, and what it is taken for.
    A plugin's effects are verified: exactly absent at null, in one stage, with a derivative that is right and not zero.

    Example: `roadfiber effects gauge_length` or `roadfiber effects --plugin mine.py`
    """
    from solver.catalogue.listing import listed, one_of, print_details, print_list
    from solver.catalogue.plugins import catalogue

    every = listed(catalogue(plugin or []))
    chosen = None if name is None else one_of(every, name)
    if as_json:
        import json

        print(json.dumps(every if chosen is None else chosen, indent=1))
    elif chosen is None:
        print_list(every)
    else:
        print_details(chosen, every)
