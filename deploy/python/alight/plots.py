"""Figures of landings, studies and envelopes, by matplotlib. Each function returns the figure; `savefig` writes it.

Colours are those of Okabe and Ito, which remain distinct for colour-blind users. Lines also differ in style, and cells in the
pattern of their class; a cell is a darker blue the more of its trials landed.
"""

from __future__ import annotations

from typing import Any, Dict, List

from ._folders import Envelope, Study
from ._lazy import Lazy
from ._lazy import numpy as np
from ._program import AlightError
from ._relative import configured, relative
from ._run import Run

figure = Lazy("matplotlib.figure")
patches = Lazy("matplotlib.patches")

BLUE, ORANGE, GREEN, RED, PURPLE = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#CC79A7"
COLOURS = [BLUE, RED, GREEN, PURPLE, ORANGE]
DASHES = ["-", "--", "-.", ":"]
GREY, EDGE = "#777777", "#555555"
# Class of an envelope's cell: its pattern, and the fraction landed whose colour the legend shows.
CLASSES = {"landed": ("", 1.0), "rejected": ("//", 0.0), "unsafe": ("xx", 0.0)}
# Ends of the colour scale for the fraction landed, none to all: ColorBrewer's Blues.
NONE_LANDED, ALL_LANDED = (222, 235, 247), (49, 130, 189)
# Metric of Table II: name in the summary, label of the axis.
TABLE2 = [
    ("position_error_m", "position\nerror, m"),
    ("landing_time_s", "landing\ntime, s"),
    ("touchdown_speed_mps", "touchdown\nspeed, m/s"),
]


def landing(run: Run, before_s: float = 15.0, after_s: float = 0.0):
    """One landing in the layout of the paper's figure 4: the path from above, and, over the time to touchdown, the
    displacement to the deck, the velocities, and the differences in roll and pitch, and in yaw.

    The panels over time show `before_s` (s) before the first contact and `after_s` after it; the path is complete. A run without
    a landing is shown to its end. The figure shows the truth of a simulated landing, and the drone's estimate of a flight.
    """
    r = relative(run)
    landed = bool(np.isfinite(r["to_touchdown_s"]).all())
    time = r["to_touchdown_s"] if landed else r["time_s"] - r["time_s"][-1]
    span = (time >= -before_s) & (time <= (after_s if landed else 0.0))
    shown = time[span]
    # The figure ends at the contact itself, between two records.
    ends = landed and after_s == 0.0 and time[-1] > 0.0
    if ends:
        shown = np.append(shown[shown < 0.0], 0.0)

    def over(values):
        return np.interp(shown, time, values)

    drawn = figure.Figure(figsize=(10, 8), layout="constrained")
    grid = drawn.add_gridspec(4, 2, width_ratios=[1, 1.25])
    path = drawn.add_subplot(grid[:, 0])
    axes = [drawn.add_subplot(grid[row, 1]) for row in range(4)]
    _path(path, r, time, landed)
    forward, starboard, height = r["displacement_m"].T
    for k, (name, values) in enumerate([("forward", forward), ("starboard", starboard), ("height", height)]):
        axes[0].plot(shown, over(values), DASHES[k], color=COLOURS[k], label=name)
    for k, (name, of) in enumerate([("drone", r["drone_mps"]), ("deck", r["deck_mps"])]):
        for part, axis in enumerate(["north", "east", "up"]):
            values = over(of[:, part] * (-1 if axis == "up" else 1))
            # One colour per axis; the line style distinguishes deck and drone.
            label = axis if name == "drone" else {"north": "deck: dashed"}.get(axis)
            axes[1].plot(shown, values, DASHES[k], color=COLOURS[part], label=label)
    for k, name in enumerate(["roll", "pitch"]):
        axes[2].plot(shown, over(r[f"{name}_deg"]), DASHES[k], color=COLOURS[k], label=name)
    # The yaw difference is unwrapped, so that it does not jump from 180 to -180 deg.
    yaw = np.degrees(np.unwrap(np.radians(r["yaw_deg"])))
    last = yaw[np.argmin(np.abs(time))]
    yaw -= 360.0 * np.round(last / 360.0)
    axes[3].plot(shown, over(yaw), color=BLUE, label="yaw")
    names = [
        "displacement\nto the deck, m",
        "velocity of drone\nand deck, m/s",
        "roll and pitch\ndifference, deg",
        "yaw\ndifference, deg",
    ]
    for axis, name in zip(axes, names):
        axis.set_ylabel(name)
        axis.axhline(0.0, color=GREY, linewidth=0.6)
        if landed:
            axis.axvline(0.0, color=GREY, linewidth=0.8, linestyle=":")
        axis.set_xlim(-before_s, max(after_s, 0.0))
        axis.grid(alpha=0.3)
        if axis is not axes[-1]:
            axis.tick_params(labelbottom=False)
    for axis in axes[:3]:
        _legend_above(axis)
    axes[-1].set_xlabel("time to touchdown, s" if landed else "time to the end of the recording, s")
    drawn.suptitle(_title(run, r["source"]), wrap=True, fontsize="medium")
    return drawn


def _legend_above(axis, **names) -> None:
    # The legend is above the panel, so that it covers nothing.
    place = {"loc": "lower left", "bbox_to_anchor": (0.0, 1.0), "ncols": 6, "borderpad": 0.1}
    axis.legend(**names, **place, fontsize="x-small", frameon=False)


def _path(axis, r: Dict[str, Any], time, landed: bool) -> None:
    until = time <= 0.0 if landed else np.ones_like(time, dtype=bool)
    for name, place, colour, dash in [("drone", r["drone_m"], BLUE, "-"), ("deck", r["deck_m"], RED, "--")]:
        axis.plot(place[until, 1], place[until, 0], dash, color=colour, label=name)
    drone = r["drone_m"][until]
    axis.plot(drone[0, 1], drone[0, 0], "o", color=BLUE, label="start")
    if landed:
        axis.plot(drone[-1, 1], drone[-1, 0], "*", color="black", markersize=10, label="touchdown")
    axis.set_xlabel("east, m")
    axis.set_ylabel("north, m")
    axis.set_title("path from above", fontsize="medium")
    axis.set_aspect("equal", adjustable="datalim")
    axis.grid(alpha=0.3)
    axis.legend(fontsize="small")


def _title(run: Run, source: str) -> str:
    of = run.outcome
    parts = [f"sea {of['sea']}" if "sea" in of else "", f"seed {of['seed']}" if "seed" in of else ""]
    parts += [f"planner {of['planner']}" if "planner" in of else "", str(of.get("outcome", ""))]
    if source == "belief":
        parts.append("as the drone believed it")
    if of.get("position_error_m") is not None:
        parts.append(f"{of['position_error_m']:.2f} m off the centre at {of['touchdown_speed_mps']:.2f} m/s")
    return "Landing: " + (", ".join(part for part in parts if part) or "one recording")


# Moments of a landing: the mission's state, and the fraction of its duration.
MOMENTS = [("Tracking stable", 1.0), ("Descent", 0.5), ("Flare", 0.4), ("Landed", 1.0)]
# Half of a panel's width, and its extent above and below the deck's centre, m.
SIDE_M, ABOVE_M, BELOW_M = 4.75, 8.4, 1.8


def moments(run: Run):
    """Four moments of a landing as the drone estimates them, seen from starboard, forward to the right: the deck, its forecast, the
    drone and its plan, around the deck's centre at that moment. Of several landings the last is drawn."""
    r = relative(run)
    touchdown = run.touchdown_s()
    if touchdown is None:
        raise AlightError(f"nothing landed in {run.path or 'this run'}: there are no moments of a landing to draw")
    # Panels keep their aspect ratio, because a stretched panel would distort slopes.
    drawn = figure.Figure(figsize=(12, 4.2), layout="compressed")
    axes = drawn.subplots(1, len(MOMENTS), sharey=True)
    for axis, (state, part) in zip(axes, MOMENTS):
        at = _within(run, state, part)
        _moment(axis, run, r, at, has_plan=state != "Landed")
        axis.set_title(f"{state}, {at - touchdown:+.1f} s", fontsize="medium")
        axis.set_xlabel("forward of the deck's centre, m")
        axis.set_aspect("equal")
        axis.set_xlim(-SIDE_M, SIDE_M)
        axis.set_ylim(-BELOW_M, ABOVE_M)
        axis.grid(alpha=0.3)
    axes[0].set_ylabel("height, m")
    handles, labels = axes[0].get_legend_handles_labels()
    drawn.legend(handles, labels, loc="outside lower center", ncols=len(labels), frameon=False)
    drawn.suptitle(_title(run, r["source"]) + "; times to the touchdown", wrap=True, fontsize="medium")
    return drawn


def _within(run: Run, state: str, part: float) -> float:
    """Time at this fraction of the mission's last period in a state."""
    mission = run.topic("/mission")
    inside = np.flatnonzero(mission["state"] == state)
    if not len(inside):
        raise AlightError(f"the mission of {run.path or 'this run'} was never in the state {state}")
    # Searches backwards from the end for the previous state.
    gaps = np.flatnonzero(np.diff(inside) > 1)
    began, ended = mission["time_s"][inside[gaps[-1] + 1 if len(gaps) else 0]], mission["time_s"][inside[-1]]
    return float(began + part * (ended - began))


def _moment(axis, run: Run, r: Dict[str, Any], at: float, has_plan: bool) -> None:
    def now(name):
        return np.array([np.interp(at, r["time_s"], column) for column in r[name].T])

    drone, deck, nearest = now("drone_m"), now("deck_m"), np.argmin(np.abs(r["time_s"] - at))
    heading = np.radians(r["deck_deg"][nearest, 2])
    odometry = run.topic("/drone/odometry")
    # Forecast and plan are in the odometry's own north, east, down.
    own = np.array([np.interp(at, odometry["time_s"], column) for column in odometry["position_m"].T])

    def side(places):
        """Distance forward of the deck's centre, and height."""
        north, east, down = (places - deck).T
        return north * np.cos(heading) + east * np.sin(heading), -down

    def bar(place, half_m, attitude_deg, **style):
        forward, height = side(place)
        slope = _slope(attitude_deg, heading)
        axis.plot(forward + half_m * np.array([-1, 1]), height + half_m * slope * np.array([-1, 1]), **style)

    newest = {}
    for topic in ("/deck/forecast/path", "/plan/path"):
        series = run.topic(topic)
        before = np.flatnonzero(series["time_s"] <= at + 1e-6)
        newest[topic] = side(series["position_m"][before[-1]] + drone - own) if len(before) else ([], [])
    axis.plot(*newest["/deck/forecast/path"], color=GREEN, label="forecast of its centre")
    if has_plan:
        axis.plot(*newest["/plan/path"], "--", color=BLUE, label="plan")
    bar(deck, configured(run, "length_m", 2.5) / 2, r["deck_deg"][nearest], color=RED, linewidth=4, label="deck")
    bar(drone, 0.35, r["drone_deg"][nearest], color=BLUE, linewidth=3, label="drone")


def _slope(attitude_deg, heading: float) -> float:
    """Slope of a body's plane along a heading (rad), from its roll, pitch and yaw; positive if the forward end is up."""
    roll, pitch, yaw = np.radians(attitude_deg)
    yaw -= heading
    # The body's down axis, in axes of which the first points along the heading.
    forward = np.cos(yaw) * np.sin(pitch) * np.cos(roll) + np.sin(yaw) * np.sin(roll)
    return forward / (np.cos(pitch) * np.cos(roll))


def table2(study: Study):
    """The paper's Table II as a figure: for each of its seas the landing rate, and the means of position error, landing time and
    touchdown speed with a line to the 95th percentile, next to the published values. Other studies are drawn in the same way."""
    scenes = list(dict.fromkeys(row["scenario"] for row in study.summary))
    planners = list(dict.fromkeys(row["planner"] for row in study.summary))
    if not scenes:
        raise AlightError(f"the study {study.name} has no rows to draw")
    drawn = figure.Figure(figsize=(max(6.0, 1.0 * len(scenes) + 2.0), 8), layout="constrained")
    axes = drawn.subplots(1 + len(TABLE2), 1, sharex=True, height_ratios=[0.6, 1, 1, 1])
    width = 0.6 / len(planners)
    for k, planner in enumerate(planners):
        rows = [row for row in study.summary if row["planner"] == planner]
        places = [scenes.index(row["scenario"]) + width * (k - (len(planners) - 1) / 2) for row in rows]
        style = {"color": COLOURS[k % len(COLOURS)], "marker": "osD^v"[k % 5]}
        _rates(axes[0], rows, places, style)
        for axis, (metric, _) in zip(axes[1:], TABLE2):
            _means(axis, rows, places, metric, style, planner)
    _published(axes[1:], study.summary, scenes)
    axes[0].set_ylabel("landed, %")
    for axis, (_, name) in zip(axes[1:], TABLE2):
        axis.set_ylabel(name)
        axis.set_ylim(bottom=0.0)
    for axis in axes:
        axis.grid(alpha=0.3, axis="y")
    axes[-1].set_xticks(range(len(scenes)), scenes, rotation=0 if max(map(len, scenes)) < 8 else 30)
    pair = all(len(scene.split(",")) == 2 for scene in scenes)
    axes[-1].set_xlabel("sea: amplitude, m, and period, s" if pair else "row of the study")
    handles, labels = axes[1].get_legend_handles_labels()
    _legend_above(axes[0], handles=handles, labels=labels)
    trials = sorted({row["trials"] for row in study.summary})
    flown = f"{trials[0]}" if len(trials) == 1 else f"{trials[0]} to {trials[-1]}"
    flown += " landing" if trials[-1] == 1 else " landings"
    drawn.suptitle(
        f"Study {study.name}: mean and 95th percentile of {flown} a row, landed with its 95 % interval",
        fontsize="medium",
        wrap=True,
    )
    return drawn


def curves(study: Study, metric: str = "position_error_m"):
    """A study whose scenes have two axes, such as `link`: the mean of a metric, or the percentage that `landed`, over the choices
    of the first axis, with a line for each choice of the second. A panel for each grid and planner."""
    places: Dict[str, Dict[str, None]] = {}
    for row in study.summary:
        place, comma, line = row["scenario"].partition(", ")
        if not comma:
            raise AlightError(f"the scene {place} of the study {study.name} has one axis: curves need two")
        places.setdefault(place, {})[line] = None
    grids: Dict[tuple, List[str]] = {}
    for place, lines in places.items():
        grids.setdefault(tuple(lines), []).append(place)
    planners = list(dict.fromkeys(row["planner"] for row in study.summary))
    values = {(row["scenario"], row["planner"]): _value(row, metric) for row in study.summary}
    drawn = figure.Figure(figsize=(6.0 * len(planners), 4.0 * len(grids)), layout="constrained")
    axes = drawn.subplots(len(grids), len(planners), squeeze=False)
    for row, (lines, across) in zip(axes, grids.items()):
        for axis, planner in zip(row, planners):
            for k, line in enumerate(lines):
                heights = [values.get((f"{place}, {line}", planner), np.nan) for place in across]
                style = {"color": COLOURS[k % len(COLOURS)], "marker": "osD^v"[k % 5]}
                axis.plot(range(len(across)), heights, DASHES[k % len(DASHES)], label=line, **style)
            axis.set_xticks(range(len(across)), across, rotation=20, fontsize="small")
            axis.set_ylim(bottom=0.0)
            axis.set_ylabel("landed, %" if metric == "landed" else metric)
            axis.set_title(planner, fontsize="medium")
            axis.grid(alpha=0.3)
            axis.legend(fontsize="small")
    return drawn


def _value(row: Dict[str, Any], metric: str) -> float:
    if metric == "landed":
        return 100.0 * row["successes"] / row["trials"]
    # Without a landing there are no measurements.
    return row[metric]["mean"] if row.get(metric) else float("nan")


def _rates(axis, rows: List[Dict[str, Any]], places, style) -> None:
    rates = [100.0 * row["successes"] / row["trials"] for row in rows]
    ends = [[100.0 * end for end in row["success_rate_95"]] for row in rows]
    errors = [
        [max(0.0, rate - low) for rate, (low, _) in zip(rates, ends)],
        [max(0.0, high - rate) for rate, (_, high) in zip(rates, ends)],
    ]
    axis.errorbar(places, rates, yerr=errors, linestyle="", markersize=5, capsize=2, **style)
    axis.set_ylim(0.0, 105.0)


def _means(axis, rows, places, metric, style, planner) -> None:
    # Without a landing there are no measurements.
    known = [(place, row[metric]) for place, row in zip(places, rows) if row.get(metric)]
    at = [place for place, _ in known]
    means = [value["mean"] for _, value in known]
    above = [max(0.0, value["p95"] - value["mean"]) for _, value in known]
    axis.errorbar(
        at, means, yerr=[[0.0] * len(at), above], linestyle="", markersize=5, elinewidth=1, label=planner, **style
    )


def _published(axes, summary, scenes) -> None:
    for axis, (metric, _) in zip(axes, TABLE2):
        marks = dict.fromkeys(
            (scenes.index(row["scenario"]), row["published"][metric])
            for row in summary
            if (row.get("published") or {}).get(metric) is not None
        )
        for k, (place, value) in enumerate(marks):
            label = "published" if k == 0 else None
            axis.hlines(value, place - 0.35, place + 0.35, colors=GREY, linewidth=2, label=label)


def envelope(envelope: Envelope):
    """An envelope as a polar diagram: a circle for each sea state, bow up, rings for the relative wind (m/s), sectors for the
    direction from which the wind blows. A cell is darker the more of its trials landed, has the pattern of its class, and shows
    landed of flown, and after `!` the number of unsafe landings (in red). The black line is the limit (`Envelope.limit`); it is
    omitted if too few trials were flown."""
    grid = envelope.grid
    states, winds = grid["sea_states"], sorted(grid["winds_mps"])
    columns = min(2, len(states))
    lines = -(-len(states) // columns)
    drawn = figure.Figure(figsize=(5.2 * columns, 5.4 * lines + 0.6), layout="constrained")
    # A ring extends halfway to its neighbours.
    middles = [(a + b) / 2 for a, b in zip(winds, winds[1:])]
    half = (winds[1] - winds[0]) / 2 if len(winds) > 1 else winds[0] / 2
    edges = [max(0.0, winds[0] - half), *middles, winds[-1] + (winds[-1] - (middles[-1] if middles else winds[-1] - half))]
    width = 2 * np.pi / grid["directions"]
    for k, state in enumerate(states):
        axis = drawn.add_subplot(lines, columns, k + 1, projection="polar")
        axis.set_theta_zero_location("N")
        axis.set_theta_direction(-1)
        for cell in (c for c in envelope.cells if c["sea_state"] == state):
            ring = winds.index(cell["wind_mps"])
            colour = _shade(cell["class"], cell["landed"] / max(1, cell["trials"]))
            hatch = CLASSES[cell["class"]][0]
            angle, low, high = np.radians(cell["from_deg"]), edges[ring], edges[ring + 1]
            axis.bar(angle, high - low, width, low, color=colour, hatch=hatch, edgecolor=EDGE, linewidth=0.5)
            count = f"!{cell['unsafe']}/{cell['trials']}" if cell["unsafe"] else f"{cell['landed']}/{cell['trials']}"
            plate = {"boxstyle": "round,pad=0.15", "facecolor": "white", "edgecolor": "none", "alpha": 0.8}
            axis.text(angle, (low + high) / 2, count, ha="center", va="center", fontsize="xx-small", bbox=plate)
        if not envelope.too_few:
            _limit(axis, envelope, state, winds, edges, width)
        axis.set_ylim(0.0, edges[-1])
        axis.set_yticks(winds, [f"{wind:g}" for wind in winds])
        # Between two sectors, where no count is shown.
        axis.set_rlabel_position(np.degrees(width) / 2)
        axis.set_xticks(np.radians(np.arange(0, 360, 45)), [f"{a} deg" if a else "bow" for a in range(0, 360, 45)])
        axis.tick_params(axis="x", pad=8)
        axis.grid(alpha=0.3)
        axis.set_title(f"sea state {state}", fontsize="medium")
    shown = [
        patches.Patch(facecolor=_shade(name, share), hatch=hatch, edgecolor=EDGE, label=name)
        for name, (hatch, share) in CLASSES.items()
    ]
    drawn.legend(handles=shown, loc="outside lower center", ncols=len(shown))
    percent = 100.0 * envelope.rate
    limit = f"no limit: {envelope.too_few}" if envelope.too_few else f"line: limit, {percent:.0f} % shown"
    drawn.suptitle(f"Envelope of {envelope.hull}: relative wind, m/s\n{limit}", fontsize="small", wrap=True)
    return drawn


def _shade(name: str, landed: float) -> str:
    """Colour of a cell of this class of which this fraction landed, 0 to 1."""
    if name == "unsafe":
        return RED
    steps = (round(low + landed * (high - low)) for low, high in zip(NONE_LANDED, ALL_LANDED))
    return "#" + "".join(f"{step:02x}" for step in steps)


def _limit(axis, envelope: Envelope, state: int, winds, edges, width: float) -> None:
    angles: List[float] = []
    radii: List[float] = []
    for k in range(envelope.grid["directions"]):
        limit = envelope.limit(state, 360.0 * k / envelope.grid["directions"])
        radius = 0.0 if limit is None else edges[winds.index(limit) + 1]
        # The arc of the sector; between two sectors the line steps radially.
        angles.extend(np.linspace((k - 0.5) * width, (k + 0.5) * width, 12))
        radii.extend([radius] * 12)
    axis.plot([*angles, angles[0]], [*radii, radii[0]], color="black", linewidth=2)
