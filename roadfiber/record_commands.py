"""`roadfiber ingest` and `roadfiber view`."""

from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer()


@app.command()
def ingest(
    site: Annotated[Path, typer.Argument(help="The survey's site.toml, or its folder.")],
    out: Annotated[
        Path | None, typer.Option(help="Folder of the store.", show_default="das-store beside site.toml")
    ] = None,
    rate: Annotated[float, typer.Option(help="Sampling rate to keep, Hz, or a little above.")] = 20.0,
    as_json: Annotated[bool, typer.Option("--json", help="Print what was written as JSON.")] = False,
) -> None:
    """Keep a record of any length at the rate of the fit, with its gaps, noise and health.

    Files are filtered and decimated once, part by part: memory does not grow with the length, and the next run goes on
    where one was ended. `locate` and `view` use the store as long as the files stay as they are. channels.csv and
    files.csv in it say what is left out and why. DASCore opens the folder, xarray the parts.

    Example: `roadfiber ingest surveys/main-street` and then `roadfiber locate surveys/main-street`
    """
    import json

    import roadfiber as rf
    from vision.contract.statements import table_lines

    done = rf.ingest(site, out, rate=rate)
    if as_json:
        print(json.dumps(done.to_dict(), indent=1))
        return
    print(
        f"{done.store}: {done.start} to {done.end}, channels {done.channels[0]} to {done.channels[1]} at "
        f"{done.sampling_rate:g} Hz; {done.bytes / 1e6:.3g} MB, from {done.raw_bytes / 1e6:.3g} MB of files"
    )
    print("\n".join(table_lines(done.statements)))
    gaps = "no gap" if done.gaps == 0 else "1 gap" if done.gaps == 1 else f"{done.gaps} gaps"
    print(f"{gaps}; noise {done.noise:.2g} 1/s; {done.dead} channels without a signal")
    for line in done.cautions:
        print(line)


@app.command()
def view(
    site: Annotated[Path, typer.Argument(help="A site.toml, its folder, a store, or a DAS file.")],
    start: Annotated[
        str | None,
        typer.Option("--from", help="UTC as 2025-08-11T06:00:10Z, or s since the start.", show_default="the start"),
    ] = None,
    end: Annotated[
        str | None, typer.Option("--to", help="Likewise.", show_default="the store's end, or 10 min of files")
    ] = None,
    channels: Annotated[str | None, typer.Option(help="First and last, as 100-250.", show_default="all")] = None,
    out: Annotated[Path, typer.Option(help="Picture to write: .png, .svg or .pdf.")] = Path("view.png"),
) -> None:
    """Draw the waterfall of a record: time, channel, strain rate in sigmas of the noise. No trajectories are needed.

    Example: `roadfiber view surveys/main-street --from 2025-08-11T06:00:00Z --to 240 --channels 100-250`
    """
    from roadfiber.ingesting import draw_view
    from vision.contract import InputError, require_writable, writing
    from vision.contract.statements import table_lines

    if out.suffix.lower() not in (".png", ".svg", ".pdf"):
        raise InputError(f"--out {out}: give a name that ends in .png, .svg or .pdf")
    require_writable(out)
    seen = draw_view(site, start, end, None if channels is None else channels_of(channels))
    with writing(out) as path:
        seen.figure.savefig(path)
    print("\n".join([*table_lines(seen.statements), *seen.cautions, f"wrote {out}"]))


def channels_of(text: str) -> tuple[int, int]:
    """Read first and last channel.

    >>> channels_of("100-250"), channels_of("-20--4")
    ((100, 250), (-20, -4))
    """
    import re

    from vision.contract import InputError

    found = re.fullmatch(r"\s*(-?\d+)\s*[-:,]\s*(-?\d+)\s*", text)
    if found is None:
        raise InputError(f"--channels {text}: give the first and the last, as 100-250")
    return int(found[1]), int(found[2])
