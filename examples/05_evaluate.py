"""Judge a run against ground truth, by the protocol `goc`.

    python examples/05_evaluate.py [FOLDER]

FOLDER (default: out/example) is what 01_carve.py has filled. docs/guide/eval.md says what each figure means.
"""

import sys
from pathlib import Path

from goc.evaluation import evaluate, write_evaluation


def main(folder: Path) -> None:
    """Compare the carved objects with the true ones."""
    found = evaluate(folder / "carved", folder / "room")
    print(f"{found.counts.found} of {found.counts.objects} objects found, {found.counts.watertight} watertight")
    for name in ("accuracy", "completion", "f_score_0.05", "iou"):
        value = found.mean[name]
        print(f"{name}: {'undefined' if value is None else f'{value:.3f}'} (mean of {found.mean_over[name]} objects)")
    worst = min(found.objects, key=lambda id: found.objects[id].figures["f_score_0.05"] or 0.0)
    print(f"worst: object {worst}, {found.objects[worst].label}")
    write_evaluation(found, folder / "judged", worst=1)
    print(f"look at {folder / 'judged' / 'eval.html'}")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "out/example"))
