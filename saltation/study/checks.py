"""A scene before it is run: its dimensionless numbers, what a run computes and what not, and warnings."""

from __future__ import annotations

from typing import NamedTuple

from saltation.effects import EFFECTS, warnings_of
from saltation.flight.cost import FLIGHT
from saltation.flight.setup import Engine
from saltation.flow import PROFILES, REGIMES, saltation_layer
from saltation.scene import AUTO, Coupling, Scene
from saltation.scene.conditions import settling_velocity
from saltation.scene.presets import differences
from saltation.scene.valid import left, lubricated

POINTS = 125  # of the path in a typical jump by collocation
KEPT = 1e3  # bytes that a point of a grain's path or a jump takes, with its copies
POSITION = 150.0  # bytes that a position of a grain of a cloud takes, with its copies
MUCH = 1e9  # bytes


class Number(NamedTuple):
    """One dimensionless number: symbol, value, what it is."""

    symbol: str
    value: float
    meaning: str


def numbers(scene: Scene) -> list[Number]:
    """The dimensionless numbers of a scene; those of the stream only where there is one."""
    n = scene.numbers
    found = [
        Number("ρ_s/ρ", n.density_ratio, "density of the grain over the fluid's"),
        Number("R_p", n.particle_reynolds, "particle Reynolds number √(R g d³)/ν"),
    ]
    if scene.channel is not None and n.stage is not None:
        height = scene.channel.roughness_height or scene.grain.diameter
        found += [
            Number("τ*", n.shields, "Shields parameter"),
            Number("τ*c", n.critical_shields, "its critical value"),
            Number("T", n.stage, "transport stage τ*/τ*c"),
            Number("k_s+", n.reynolds * height / n.diameter, "roughness Reynolds number u* k_s/ν"),
        ]
    found += [
        Number("Re*", n.reynolds, "Reynolds number V d/ν; V is u*, or √(|R| g d) in still water"),
        Number("α", n.alpha, "1/(1 + R + C_m)"),
    ]
    if "history" in scene.names:
        found.append(Number("c", n.history, "coefficient of the history force, 9α/√(π Re*)"))
    if scene.bed is not None:
        found.append(Number("St/V_n", n.stokes(1.0), f"collision Stokes number per normal velocity in {n.unit('u*')}"))
    speed = settling_velocity(scene)
    if speed is not None and scene.channel is not None:
        found.append(Number("w_s/u*", speed / n.velocity, "settling velocity over shear velocity"))
    return found


def computed(scene: Scene) -> dict[str, str]:
    """What a run of the scene computes (state, spin, forces, memory, …), a line of text each."""
    engine = Engine(scene)
    axes = "xz" if scene.in_plane else "xyz"
    names = [*axes, *({"x": "u", "y": "v", "z": "w"}[axis] for axis in axes)]
    if engine.rotation is not None:
        names += ["spin_y"] if scene.in_plane else ["spin_x", "spin_y", "spin_z"]
    found = {"state": f"{engine.states} numbers: {', '.join(names)}"}
    if engine.prescribed is not None:
        found["spin"] = f"prescribed, {engine.prescribed:.4g} u*/d"
    elif engine.rotation is None and scene.turns:
        found["spin"] = "changes at contacts only"
    found["forces"] = ", ".join(engine.force_names) or "none"
    if engine.members:
        found["memory"] = _memory(scene, engine)
    stream = scene.channel
    if stream is not None:
        profile = REGIMES.get(stream.profile, stream.profile)
        found["stream"] = f"{stream.profile}: {PROFILES[profile]}, u* = {scene.numbers.velocity:.4g} m/s"
    if scene.coupling is not None:
        found["coupling"] = _coupling(scene, scene.coupling)
    if scene.rests is not None:
        found["rests"] = (
            f"of {1.0 / scene.rests.entrainment:g} s on average, after a hop no longer in time than one that rises {scene.rests.rise:g} d under weight alone"
        )
    if scene.bed is not None:
        bed = scene.bed
        friction = f"f = {bed.friction:g}" if bed.friction is not None else f"tangential retention {bed.tangential_retention:g}"
        restitution = f"0.97 exp(−{scene.stokes_decay:g}/St)" if bed.restitution == "stokes" else bed.restitution
        found["bed"] = f"{bed.rebound}, e = {restitution}, {friction}, {bed.contact_mass} contact mass; roughness {bed.roughness}, contact angles {bed.reading}"
    if scene.cloud is not None:
        length, width, height = scene.box
        found["grains"] = f"{scene.cloud.number} from a layer of {length:.4g} × {width:.4g} × {height:.3g} d, C_p = {scene.cloud.concentration:g}"
        if "encounters" in scene.names:
            pairs = scene.options("encounters")
            found["encounters"] = f"hard spheres, e = {pairs.restitution:g}, f = {pairs.friction:g}, {scene.cloud.boundary} along and across"
    solver, unit = scene.solver, _unit_of_time(scene)
    found["solver"] = f"collocation, rtol = {solver.rtol:g}" if solver.method == "collocation" else f"{solver.method}, dt = {solver.dt:g} {unit}"
    time = f"{scene.run.duration:g} s ({scene.end:.4g} {unit})" if scene.run.duration is not None else ""
    lasts = f"{scene.run.jumps} jumps, the first {scene.run.discard} left out" if scene.run.jumps is not None else time
    found["run"] = f"{lasts}; seed {scene.run.seed}"
    if scene.bed is not None:
        found["ends early"] = f"if the grain comes to rest, creeps along the bed or stays off it longer than {scene.longest_flight:.4g} {unit}"
    if stream is None:
        found["units"] = f"d = {scene.grain.diameter:g} m, V = √(|R| g d) = {scene.numbers.velocity:.4g} m/s, in place of u*; times in d/V"
    if scene.effects == AUTO:
        found["effects"] = "all of them here; a run first determines by simulation which can be left out"
    return found


def _coupling(scene: Scene, coupling: Coupling) -> str:
    """What grains do to the stream."""
    if coupling.form == "roughness":
        assert scene.numbers.stage is not None
        layer = saltation_layer(scene.numbers.stage, scene.grain.diameter)
        return f"roughness: a layer of {layer:.3g} d adds {0.056 * layer:.3g} d to the roughness length (Wiberg & Rubin 1989)"
    if scene.cloud is not None:
        number = "as many grains per area as the table [cloud] says"
    elif coupling.grains is not None:
        number = f"{coupling.grains:g} moving grains per m²"
    else:
        number = f"grains until the stream's stress at the bed is τ_c + {coupling.excess:g} (τ₀ − τ_c)"
    return f"two_way: {number}; runs are repeated until the stresses add up to the total within {coupling.tolerance:g} ρu*²"


def _memory(scene: Scene, engine: Engine) -> str:
    options = scene.options("history")
    after = f"; at an impact: {options.rebound}" if scene.bed is not None else ""
    last = f", the last {options.window_jumps} jumps only" if options.window_jumps is not None else ""
    if scene.solver.method != "collocation":
        slip = f" of the slip at {options.slip_at or 't'}" if options.kernel != "basset" else ""
        return f"{engine.members} components of the slip, {scene.history_rule()!r}, kernel {options.kernel}{slip}{last}{after}"
    grows = engine.problem.end < engine.end or (options.horizon is None and scene.run.duration is None)
    reach = f"lags up to {engine.horizon:g} {_unit_of_time(scene)}{', or longer if the run is' if grows else ''}"
    return f"{engine.members} components of the slip × {len(engine.rates)} exponentials, kernel {options.kernel}, {reach}{last}{after}"


def _unit_of_time(scene: Scene) -> str:
    """In still water there is no u*."""
    return "d/u*" if scene.channel is not None else "d/V"


def left_out(scene: Scene) -> list[str]:
    """What a run of the scene does not compute: no state, no memory, no time goes into it."""
    meaningless = {"encounters"} if scene.cloud is None else set()  # a single grain meets nobody
    missing = [f"{name} (not among the effects)" for name in EFFECTS if name not in scene.names and name not in meaningless]
    if not scene.turns:
        missing.append("spin (no effect depends on it)")
    if scene.in_plane:
        missing.append("motion across the stream (two dimensions)")
    if scene.channel is None:
        missing.append("a stream (no [channel])")
    if scene.bed is None:
        missing.append("a bed (no [bed])")
    return missing


def ignored(scene: Scene) -> list[str]:
    """Names of the tables that a scene gives for effects that it does not have."""
    return [name for name in EFFECTS if name not in scene.names and getattr(scene, name) is not None]


def _memory_ends(scene: Scene) -> str:
    """A memory that is given may end before the run."""
    given = scene.options("history").horizon if "history" in scene.names else None
    if given is None:
        return ""
    time = None if scene.run.duration is None else scene.run.duration / scene.numbers.time
    if time is not None and time <= given:
        return ""
    lasts = "outlasts it" if time is None else f"lasts {time:.4g} {_unit_of_time(scene)} and outlasts it"
    return f"history.horizon = {given:g} {_unit_of_time(scene)} is given: a run that {lasts} ends there; left out, it grows with the run"


def _takes_memory(scene: Scene) -> str:
    """What a long run keeps."""
    cloud, dt, grains = scene.cloud, scene.solver.dt, scene.cloud.number if scene.cloud is not None else 1
    jumps = grains * (scene.end / FLIGHT if scene.run.jumps is None else scene.run.jumps) if scene.bed is not None else 0.0
    points = 0.0
    if scene.run.trajectory and cloud is not None:
        points = grains * scene.end / cloud.interval
    elif scene.run.trajectory and dt is not None:
        points = (scene.end if scene.run.jumps is None else scene.run.jumps * FLIGHT) / dt
    elif scene.run.trajectory:
        points = POINTS * jumps
    size = KEPT * jumps + (KEPT if cloud is None else POSITION) * points
    if size < MUCH:
        return ""
    kept = " and ".join(f"{count:.2g} {what}" for count, what in ((jumps, "jumps"), (points, "points of the path")) if count)
    spare = "longer steps make a shorter path, " if dt is not None else ""
    folder = "" if cloud is None or dt is not None else " unless --output names a folder"
    return f"some {kept} are kept, about {size / 1e9:.2g} GB of memory{folder}" + (f": {spare}run.trajectory = false stores no path" if points else "")


def _comes_to_rest(scene: Scene) -> str:
    """Nothing keeps a grain moving in still water."""
    if scene.bed is None or scene.channel is not None or scene.bed.restitution == 1.0:
        return ""
    return "in still water the grain bounces lower each time and comes to rest: the run may end before its jumps"


def _counted_twice(scene: Scene) -> str:
    """A law of the restitution by the Stokes number holds what lubrication takes."""
    if scene.bed is None or scene.bed.restitution != "stokes" or not lubricated(scene):
        return ""
    return "bed.restitution = 'stokes' includes lubrication, and so does the effect 'wall': give the dry restitution, such as bed.restitution = 0.97"


def _speeds_up(scene: Scene) -> str:
    """A law of the wall that is a difference to a drag which is not there."""
    if "wall" not in scene.names or "drag" in scene.names or scene.options("wall").parallel != "zeng":
        return ""
    return (
        "wall.parallel = 'zeng' is a difference to a drag law: without 'drag' it is slightly negative some 700 d above the wall and accelerates "
        "the grain there without bound: add 'drag', or take wall.parallel = 'faxen'"
    )


def warnings(scene: Scene) -> list[str]:
    """What to be wary of, one sentence or two each."""
    n = scene.numbers
    found = [f"[{name}] is ignored: {name!r} is not among the effects" for name in ignored(scene)]
    if isinstance(scene.effects, str) and scene.effects != AUTO:
        profile = scene.channel.profile if scene.channel is not None else ""
        found += [f"{scene.effects}: {text}" for text in differences(scene.preset, profile, scene.cloud is not None, scene.grain.diameter)]
    if n.stage is not None and n.stage < 1.0:
        found.append(f"T = {n.stage:.3g} is below 1, the threshold of motion: by the regressions no grain jumps")
    speed = settling_velocity(scene)
    if n.stage is not None and speed is not None and speed < n.velocity and "turbulence" not in scene.names:
        most = n.stage * (speed / n.velocity) ** 2
        found.append(
            f"suspension: the settling velocity {speed:.3g} m/s is below u* = {n.velocity:.3g} m/s (from T = {most:.3g} on); such grains are carried by "
            "turbulence (van Rijn 1984, J. Hydraul. Eng. 110, 1613), which is not among the effects"
        )
    if scene.bed is not None and ("weight" not in scene.names or n.density_ratio <= 1.0):
        lighter = "it is lighter than the fluid" if n.density_ratio < 1.0 else "it is as heavy as the fluid"
        why = "weight is not among the effects" if "weight" not in scene.names else lighter
        found.append(f"the grain may never come down: {why}")
    found += [text for text in (_memory_ends(scene), _takes_memory(scene), _comes_to_rest(scene), _counted_twice(scene), _speeds_up(scene)) if text]
    if scene.bed is None and scene.run.longest_flight is not None:
        found.append("run.longest_flight is ignored: it is for scenes with a [bed]")
    for name in scene.names:
        found += warnings_of(name, scene.options(name), n)
    return found + left(scene)
