#!/usr/bin/env python3
"""Draws the figures of docs/studies/README.md from runs of the committed scenarios.

    cargo build --release
    python3 docs/studies/control.py

Needs nothing but Python and the program, and some ten minutes on two cores (20 seeds). Each figure is one sweep of one value over
the seeds of one scenario: `sonoloop suite SCENARIO --seeds 20 --set KEY=VALUE --json`. The numbers behind it go
into a CSV file of the same name.
"""

import argparse
import csv
import json
import math
import statistics
import subprocess
from pathlib import Path

FOLDER = Path(__file__).resolve().parent
ROOT = FOLDER.parent.parent

# name, scenario, key, values, label of the axis, its values as shown, metrics below the success rate
SWEEPS = [
    ("search_step", "scenarios/lateral_recovery.yaml", "servo.sweep_speed_mm_s",
     [2.5, 5, 10, 15, 20], "search step per image (mm)", lambda v: v / 25,
     [("recovery_time_s", "recovery time (s)")]),
    ("dither", "scenarios/disturbances/drift.yaml", "servo.dither_mm",
     [0, 0.05, 0.15, 0.3, 0.45], "dither amplitude (mm)", lambda v: v,
     [("plane_to_tip_rms_mm", "plane to tip, RMS (mm)")]),
    ("delay", "scenarios/lateral_recovery.yaml", "delays.image_ms",
     [0, 80, 160, 240, 320], "image delay (ms)", lambda v: v,
     [("recovery_time_s", "recovery time (s)"), ("travel_after_loss_mm", "needle's travel after the loss (mm)")]),
]

WIDTH, PANEL, LEFT, RIGHT, TOP, GAP, BOTTOM = 560, 150, 62, 16, 12, 18, 44
INK, MUTED, COLOUR = "#1c2430", "#8a94a3", "#1f6fb2"


def runs(program, scenario, key, value, seeds):
    command = [program, "suite", scenario, "--seeds", str(seeds), "--set", f"{key}={value}", "--json"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    if done.returncode not in (0, 1):
        raise SystemExit(f"{' '.join(map(str, command))}\n{done.stderr}")
    return json.loads(done.stdout)["runs"]


def wilson(passed, count, z=1.96):
    share = passed / count
    middle = (share + z * z / (2 * count)) / (1 + z * z / count)
    half = z / (1 + z * z / count) * math.sqrt(share * (1 - share) / count + z * z / (4 * count * count))
    return max(0.0, middle - half), min(1.0, middle + half)


def spread(values):
    """Quartiles and number of those runs that have a value; None without any."""
    if not values:
        return None
    if len(values) == 1:
        return values * 3 + [1]
    return [*statistics.quantiles(values, n=4, method="inclusive"), len(values)]


def panel(index, label, xs, rows, top_value):
    """One chart: rows are (low, middle, high) or None, over evenly spaced places."""
    y0 = TOP + index * (PANEL + GAP)
    place = lambda i: LEFT + (i + 0.5) * (WIDTH - LEFT - RIGHT) / len(xs)
    height = lambda v: y0 + PANEL * (1 - v / top_value)
    out = [f'<text x="14" y="{y0 + PANEL / 2}" transform="rotate(-90 14 {y0 + PANEL / 2})" text-anchor="middle">{label}</text>']
    for k in range(5):
        value = top_value * k / 4
        y = height(value)
        out.append(f'<line x1="{LEFT}" x2="{WIDTH - RIGHT}" y1="{y:.1f}" y2="{y:.1f}" stroke="{MUTED}" stroke-width="0.4"/>')
        out.append(f'<text x="{LEFT - 6}" y="{y + 4:.1f}" text-anchor="end">{value:.3g}</text>')
    points = []
    for i, row in enumerate(rows):
        if row is None:
            out.append(f'<text x="{place(i):.1f}" y="{height(0) - 5:.1f}" text-anchor="middle" fill="{MUTED}">none</text>')
            continue
        low, middle, high = (min(v, top_value) for v in row)
        out.append(f'<line x1="{place(i):.1f}" x2="{place(i):.1f}" y1="{height(low):.1f}" y2="{height(high):.1f}" stroke="{COLOUR}" stroke-width="5" opacity="0.35"/>')
        out.append(f'<circle cx="{place(i):.1f}" cy="{height(middle):.1f}" r="3.5" fill="{COLOUR}"/>')
        points.append(f"{place(i):.1f},{height(middle):.1f}")
    out.append(f'<polyline points="{" ".join(points)}" fill="none" stroke="{COLOUR}" stroke-width="1.2"/>')
    return out


def draw(name, axis, xs, panels):
    """Panels below one another over a shared axis; bars are Wilson intervals or quartiles."""
    total = TOP + len(panels) * (PANEL + GAP) - GAP + BOTTOM
    out = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {total}" font-family="sans-serif" font-size="11" fill="{INK}">',
           f'<rect width="{WIDTH}" height="{total}" fill="white"/>']
    for index, (label, rows) in enumerate(panels):
        most = max((row[2] for row in rows if row), default=1)
        size = 10 ** math.floor(math.log10(most / 4)) if most > 0 else 1
        step = next(size * n for n in (1, 2, 2.5, 5, 10) if 4 * size * n >= most)
        top_value = 1 if label == "success rate" else 4 * step
        out += panel(index, label, xs, rows, top_value)
    for i, x in enumerate(xs):
        at = LEFT + (i + 0.5) * (WIDTH - LEFT - RIGHT) / len(xs)
        out.append(f'<text x="{at:.1f}" y="{total - BOTTOM + 16}" text-anchor="middle">{x:g}</text>')
    out.append(f'<text x="{(WIDTH + LEFT - RIGHT) / 2}" y="{total - 10}" text-anchor="middle">{axis}</text></svg>')
    (FOLDER / f"{name}.svg").write_text("\n".join(out) + "\n")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--program", default=ROOT / "target/release/sonoloop")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--only", help="name of one sweep")
    options = parser.parse_args()
    for name, scenario, key, values, axis, shown, metrics in SWEEPS:
        if options.only not in (None, name):
            continue
        table, rates, spreads = [], [], {metric: [] for metric, _ in metrics}
        for value in values:
            all_runs = runs(options.program, scenario, key, value, options.seeds)
            passed = sum(run.get("verdict") == "pass" for run in all_runs)
            low, high = wilson(passed, len(all_runs))
            rates.append((low, passed / len(all_runs), high))
            line = [value, passed, len(all_runs), round(low, 3), round(high, 3)]
            for metric, _ in metrics:
                known = [run["metrics"][metric] for run in all_runs if run.get("metrics", {}).get(metric) is not None]
                quartiles = spread(known)
                spreads[metric].append(quartiles and quartiles[:3])
                line += [round(v, 4) for v in quartiles] if quartiles else ["", "", "", 0]
            table.append(line)
            print(name, *line, flush=True)
        with open(FOLDER / f"{name}.csv", "w", newline="") as file:
            head = [key, "passed", "runs", "wilson_low", "wilson_high"]
            for metric, _ in metrics:
                head += [f"{metric}_lower_quartile", f"{metric}_median", f"{metric}_upper_quartile", f"{metric}_runs"]
            csv.writer(file, lineterminator="\n").writerows([head, *table])
        panels = [("success rate", rates)] + [(label, spreads[metric]) for metric, label in metrics]
        draw(name, axis, [shown(value) for value in values], panels)


if __name__ == "__main__":
    main()
