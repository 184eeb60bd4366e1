"""A radar in recorded motorway traffic: maps and views from above over time.

    python examples/recorded_traffic.py USA_US101-4_1_T-1.xml --ego 475

The scenario of CommonRoad (https://commonroad.in.tum.de) is not shipped; any traffic file with a
vehicle of this number will do. The script prints the scores and writes `recorded-traffic.png`.
"""

import argparse
import warnings
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import xarray as xr
from matplotlib.figure import Figure

import dechirp as dc

N_SHOWN = 4


def outline_m(item: xr.Dataset) -> np.ndarray:
    """Return the closed outline of an object as x and y, (2, 5)."""
    corners_m = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1], [1, 1]]) / 2
    along_m, across_m = (corners_m * [item["length"].item(), item["width"].item()]).T
    cos, sin = np.cos(item["heading"].item()), np.sin(item["heading"].item())
    centre_m = np.array([[item["centre_x"].item()], [item["centre_y"].item()]])
    return centre_m + np.stack([cos * along_m - sin * across_m, sin * along_m + cos * across_m])


def draw_result(result: dc.Result) -> Figure:
    """Draw range-Doppler maps above views from above, for frames over the whole run."""
    scenario = result.scenario
    assert scenario.traffic is not None and scenario.radar is not None
    assert result.traffic is not None and result.tracks is not None
    traffic = dc.open_traffic(scenario.traffic.path)
    scenes = dc.traffic.FrameScenes(traffic, result.radar, ego=scenario.traffic.ego)
    figure, axes = plt.subplots(
        2, N_SHOWN, figsize=(7.6, 6), sharex="row", sharey="row", layout="constrained"
    )
    for column, frame in enumerate(np.linspace(0, result.n_frames - 1, N_SHOWN).astype(int)):
        radar = result.radar.for_frame(frame)
        cube = dc.simulate(scenes.scene(frame), radar, seed=int(frame)).isel(frame=0)
        power = dc.power_map(cube, radar, scenario.chain).transpose("velocity", "range")
        level_db = xr.apply_ufunc(lambda p: 10 * np.log10(p / p.max()), power)
        top, bottom = axes[:, column]
        top.pcolormesh(level_db.range, level_db.velocity, level_db, vmin=-70, rasterized=True)
        top.set(title=f"{scenes.mid_frame_s(frame):.1f} s", xlabel="Range (m)", xlim=(0, 80))
        objects = result.traffic.isel(frame=frame)
        for name in objects.target.values[np.isfinite(objects["range"].values)]:
            item = objects.sel(target=name)
            x_m, y_m = outline_m(item)
            bottom.plot(y_m, x_m, "C2" if item["visible_share"] >= 0.5 else "0.7", lw=1)
        detections = result.detections.where(result.detections.frame == frame, drop=True)
        x_m = detections.range * np.cos(detections.azimuth)
        bottom.plot(detections.range * np.sin(detections.azimuth), x_m, "C1.", ms=2)
        tracks = result.tracks.isel(frame=frame)
        bottom.plot(tracks.y, tracks.x, "C0+", ms=6)
        bottom.set(xlabel="y (m, left positive)", xlim=(22, -22), ylim=(0, 80))
    axes[0, 0].set_ylabel("Velocity (m/s, receding positive)")
    axes[1, 0].set_ylabel("x (m, forward)")
    return figure


def main(arguments: list[str] | None = None) -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("trace", type=Path, help="traffic file of any format")
    parser.add_argument("--ego", type=int, default=475, help="vehicle with the radar")
    parser.add_argument("--duration", help="only this part, from the start: 2 s")
    parser.add_argument("--kind", choices=["samples", "statistical"], default="samples")
    parser.add_argument("--out", type=Path, default="recorded-traffic.png", help="figure")
    options = parser.parse_args(arguments)
    warnings.simplefilter("ignore", dc.PhysicsWarning)
    settings = [f"traffic.ego={options.ego}"]
    settings += [f"traffic.duration={options.duration}"] if options.duration else []
    scenario = dc.traffic.traffic_scenario(options.trace, settings)
    result = dc.run(scenario, kind=options.kind)
    objects = result.traffic
    assert objects is not None
    is_counted = (objects.visible_share >= 0.5) & (abs(objects.azimuth) <= np.radians(60))
    is_detected = (objects.n_detections > 0).where(is_counted)
    print(f"{is_counted.sum().item()} sightings, {is_detected.mean().item():.1%} detected")
    for name, unit in (("position_error", "m"), ("velocity_error", "m/s")):
        rms = np.sqrt((objects[name].where(is_counted) ** 2).mean().item())
        print(f"RMS of {name}: {rms:.2f} {unit}")
    draw_result(result).savefig(options.out, dpi=150)


if __name__ == "__main__":
    main()
