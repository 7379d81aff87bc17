"""One browser's page of the workbench: what is shown of a run, and what happens when something is chosen or pressed."""

import time
from html import escape
from typing import Any

import numpy as np
import panel as pn

from roadfiber.web import words
from roadfiber.web.bench import Bench
from roadfiber.web.breakdown import ByChannel, ByProperty, VehicleFrame
from roadfiber.web.browser import Browser
from roadfiber.web.controls import Controls
from roadfiber.web.figures import DepthProfile, LadderFigure, LiveMisfit, RouteMap
from roadfiber.web.film import Film
from roadfiber.web.late import Late
from roadfiber.web.outlines import outline, pass_of, window
from roadfiber.web.strain_figures import StrainMaps, Traces
from roadfiber.web.strain_maps import maps_of, worst_channel
from roadfiber.web.trial import Trial
from solver.run.report.misfit import misfit_of, pass_label, rows_of
from solver.run.rung import rung_names

#: ms between looks at what has changed where nothing calls, as in a notebook.
BEAT = 250


class Page:
    """One browser's page of a bench.

    Parameters
    ----------
    bench : that it shows, as other pages may
    film : the survey's video, or why there is none
    """

    def __init__(self, bench: Bench, film: Film | str):
        self.bench, self.film = bench, film
        self.run = bench.run
        self.comparison: Any = None
        self.listed: list[dict[str, Any]] = []
        self.zoomed, self.seen, self.frame = False, -1, -1
        self.browser = Browser()
        self.map, self.traces = RouteMap(self.pointed), Traces()
        self.maps = StrainMaps(self.tapped, self.moved)
        self.depth = DepthProfile(self.maps.channels)
        self.by_channel = Late(lambda: ByChannel(self.maps.channels))
        self.by_property, self.stack = Late(ByProperty), Late(VehicleFrame)
        self.ladder, self.live = Late(LadderFigure), Late(LiveMisfit)
        self.controls = Controls(lambda: bench.folder)
        self.trial = Trial(bench, self.controls, self.browser.later, self.show_trial)
        self.listen()
        self.show_run(first=True)
        self.tick()
        self.browser.once_loaded(bench.wake)
        pn.state.add_periodic_callback(lambda: self.browser.in_order(self.tick), period=BEAT)

    def listen(self) -> None:
        """Hear what is chosen, pressed and pointed at, and what happens on the bench."""
        controls, bench = self.controls, self.bench
        controls.heard(controls.passes, self.show_pass)
        controls.heard(controls.regions, self.show_region)
        controls.heard(controls.effects, self.choose)
        controls.heard(controls.channel, self.show_trace)
        controls.heard(controls.second, self.show_trace)
        controls.heard(controls.by, self.show_property)
        controls.pressed("add", self.add)
        controls.pressed("check", self.check)
        controls.pressed("turn", lambda: bench.turn(int(controls.channel.value)))
        for name in ("cancel", "undo", "redo", "diagnose"):
            controls.pressed(name, getattr(bench, name))
        self.maps.under.on_change("data", lambda attr, old, new: self.at(new["channel"][0], float(new["second"][0])))
        if self.browser.served:
            end = bench.watch(lambda: self.browser.later(self.tick))
            self.browser.document.on_session_destroyed(lambda context: end())

    # ---- when something changes --------------------------------------------------------------------------------------

    def moved(self) -> None:
        """The zoom has changed: draw when there is time."""
        self.zoomed = True

    def tick(self) -> None:
        """Show what has changed."""
        if self.browser.loading:
            return
        self.browser.catch_up()
        if self.zoomed:
            self.zoomed = False
            self.maps.draw()
        bench, job, controls = self.bench, self.bench.job, self.controls
        elapsed = time.monotonic() - job.begun if job else 0.0
        if bench.busy:
            controls.work.object = words.work_words(job, elapsed)
        if bench.version == self.seen:
            return
        self.seen = bench.version
        if bench.run is not self.run:
            self.show_run()
        if bench.titles is not self.titles:
            self.show_names()
        if bench.comparison is not self.comparison:
            self.show_comparison()
        if bench.candidates is not self.listed:
            self.show_candidates()
        controls.effects.label = f"What may be missing: {bench.source or 'nothing'}"
        controls.said.object = words.news_of(bench)
        controls.checked.object = words.small(bench.checked)
        controls.work.object = words.work_words(job, elapsed)
        if bench.busy and job is not None:
            self.live.figure.show(job.fits)
        self.live.place.visible = bench.busy
        self.able()

    def able(self) -> None:
        """Which buttons can be pressed."""
        can = self.bench.can
        self.controls.able(can | {"add": can["add"] and self.candidate is not None})

    # ---- the run -----------------------------------------------------------------------------------------------------

    def show_run(self, first: bool = False) -> None:
        """Draw the rung that is on the bench."""
        run, controls = self.bench.run, self.controls
        self.run = run
        self.trial.begin(None)
        self.misfits = np.nan_to_num(misfit_of(run.result, run.passes).by_pass)
        self.show_names()
        self.map.show(run)
        self.depth.show(run)
        labels = [pass_label(one) for one in run.passes]
        options = {f"{one} · misfit {self.misfits[n]:.2f}": n for n, one in enumerate(labels)}
        chosen = int(np.argmax(self.misfits)) if first else min(controls.passes.value or 0, len(labels) - 1)
        controls.set(controls.passes, options=options, value=chosen)
        self.show_trial(keep=not first)

    def show_names(self) -> None:
        """Show what names effects: the heading, and the ladder."""
        bench, rungs = self.bench, self.run.rungs
        self.titles = bench.titles
        self.controls.heading.object = words.head(bench)
        self.controls.steps.object = words.ladder_words(bench)
        if rungs:
            self.ladder.figure.show(rungs, rung_names(rungs, bench.title))
        self.ladder.place.visible = bool(rungs)

    def show_trial(self, keep: bool = True) -> None:
        """Draw the chosen pass with the preview there is, and where the route is with it; else the rung below."""
        run, before, preview = self.run, self.bench.before, self.trial.preview
        place, channel = np.zeros((0, 3)), np.zeros(0, np.int64)
        if preview is not None:
            place, channel = preview.route, run.result.fitted_channel
        elif before is not None:
            place = np.where(before.result.constrained[:, None], before.result.route, np.nan)
            channel = before.result.channel
        self.map.beside(place)
        self.depth.beside(channel, place[:, 2])
        self.show_pass(keep)

    def show_pass(self, keep: bool = False) -> None:
        """Draw the chosen pass; zoomed, and with the channel and moment, as they are where `keep`."""
        controls, preview = self.controls, self.trial.preview
        model = None if preview is None else preview.model.astype(float)
        maps = maps_of(self.run, int(controls.passes.value), model)
        self.maps.show(maps, keep)
        self.outline()
        low, high, end = int(maps.channel[0]), int(maps.channel[-1]), float(maps.seconds[-1])
        channel = controls.channel.value if keep else worst_channel(maps)
        second = controls.second.value if keep else end / 2
        controls.set(controls.channel, start=low, end=max(high, low + 1), value=int(np.clip(channel, low, high)))
        controls.set(controls.second, start=0.0, end=max(end, 0.1), value=min(second, end))
        self.show_trace()

    def show_trace(self) -> None:
        """Draw the chosen channel and moment."""
        assert self.maps.maps is not None
        second = float(self.controls.second.value)
        self.at(self.traces.show(self.maps.maps, self.controls.channel.value, second), second)

    def tapped(self, channel: float, second: float) -> None:
        """Somebody clicked a map."""
        controls = self.controls
        controls.set(controls.channel, value=int(np.clip(round(channel), controls.channel.start, controls.channel.end)))
        controls.set(controls.second, value=float(np.clip(second, controls.second.start, controls.second.end)))
        self.show_trace()

    def pointed(self, x: float, y: float) -> None:
        """Somebody clicked the map: choose the channel of the route that is nearest."""
        result = self.run.result
        apart = np.linalg.norm(result.route[:, :2] - (x, y), axis=1)
        self.tapped(result.channel[apart.argmin()], self.controls.second.value)

    def at(self, channel: float, second: float) -> None:
        """Mark a channel and the pass's vehicle on the map, and show the video's frame of the moment."""
        run, maps = self.run, self.maps.maps
        assert maps is not None
        result, one = run.result, run.passes[maps.number]
        place = [np.interp(channel, result.channel, result.route[:, axis]) for axis in (0, 1)]
        kept = np.flatnonzero(np.isin(one.rows, result.samples))
        aside = np.abs(run.time[rows_of(result, one)] - maps.start - second)
        row = int(kept[aside.argmin()])
        there = float(aside.min()) <= maps.step
        self.map.point(np.array(place), one.position[row] if there else None, bool(one.in_view[row]))
        self.show_frame(maps.start + second)

    def show_frame(self, second: float) -> None:
        """Show the video's frame of a second of the record, or say why there is none."""
        film, picture = self.film, self.controls.picture
        if isinstance(film, str):
            picture.object = words.small(film)
            return
        place = film.place(second)
        frame = -2 if place is None else place
        if frame != self.frame:
            self.frame, picture.object = frame, words.frame(film, place)

    # ---- where it fails ----------------------------------------------------------------------------------------------

    def show_comparison(self) -> None:
        """List the regions that fail, and draw the residual by everything."""
        controls = self.controls
        self.comparison = self.bench.comparison
        options = {line: at for at, line in enumerate(words.region_lines(self.bench))}
        controls.set(controls.regions, options=options, value=[], visible=bool(options) or self.comparison is None)
        controls.where.object = words.regions_news(self.bench)
        if self.comparison is not None:
            self.stack.figure.show(self.comparison)
            self.by_channel.figure.show(self.comparison)
            self.show_property()
        self.outline()

    def show_property(self) -> None:
        """Draw the residual by the chosen property."""
        if self.comparison is not None:
            self.by_property.figure.show(self.comparison, self.controls.by.value)

    def outline(self) -> None:
        """Outline the regions of the pass that is shown."""
        maps, found = self.maps.maps, []
        if maps is not None and self.comparison is not None:
            for at, region in enumerate(self.comparison.regions):
                if (box := outline(region, self.run, maps)) is not None:
                    found.append((*box, at in self.controls.regions.value))
        self.maps.outline(found)

    def show_region(self) -> None:
        """Show the chosen region in the pass where it is worst."""
        controls = self.controls
        if self.comparison is None or not controls.regions.value:
            return
        region = self.comparison.regions[controls.regions.value[-1]]
        controls.where.object = f"<p>{escape(words.region_told(region, self.bench))}</p>"
        number = pass_of(region, self.run, self.misfits)
        if number is None:
            return
        controls.set(controls.passes, value=number)
        self.show_pass()
        assert self.maps.maps is not None
        if (box := outline(region, self.run, self.maps.maps)) is not None:
            self.maps.zoom(*window(box, self.maps.maps))
            self.tapped((region.channels[0] + region.channels[1]) / 2, float(box[1].mean()))

    # ---- what may be missing -----------------------------------------------------------------------------------------

    @property
    def candidate(self) -> dict[str, Any] | None:
        """The chosen candidate."""
        chosen = [at for at in self.controls.effects.value if at < len(self.listed)]
        return self.listed[chosen[-1]] if chosen else None

    def show_candidates(self) -> None:
        """List what the run may lack."""
        controls, chosen = self.controls, self.candidate
        self.listed = self.bench.candidates
        lines = {f"{at}. {words.candidate_line(row)}": at - 1 for at, row in enumerate(self.listed, 1)}
        same = [at for at, row in enumerate(self.listed) if chosen and row["effect"] == chosen["effect"]]
        controls.set(controls.effects, options=lines, value=same)
        controls.about.object = words.candidate_words(self.candidate, self.bench)

    def choose(self) -> None:
        """A candidate was chosen: prepare to move its size."""
        row = self.candidate
        self.controls.about.object = words.candidate_words(row, self.bench)
        self.trial.begin(None if row is None else row["effect"])
        self.able()

    def add(self) -> None:
        """Put the chosen candidate into the model."""
        if (row := self.candidate) is not None:
            self.bench.add(row["effect"], words.title(row), self.controls.force.value)

    def check(self) -> None:
        """Try what stands in the code box."""
        self.bench.own(self.controls.file.value.strip(), self.controls.code.value)
