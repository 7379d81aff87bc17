"""Train the embedded detector: `python -m vision.street_detector.train --out street.onnx`.

Renders random streets (kept in a cache folder), trains on crops of them, scores the result on streets it has not seen,
and writes the ONNX file with its metadata. Seeded: the same machine gives the same file.
"""

import argparse
import copy
import logging
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import cv2
import numpy as np
import torch
from torch import nn

from vision.contract import progress
from vision.street_detector.batches import batch
from vision.street_detector.export import save_onnx
from vision.street_detector.loss import detection_loss
from vision.street_detector.model import StreetNet
from vision.street_detector.scenes import Samples, make_samples
from vision.street_detector.scores import onnx_detector, score

logger = logging.getLogger("roadfiber")

HELD_OUT = 100_000  # first seed of the streets kept for scoring
THRESHOLD = 0.4


def train(
    samples: Samples,
    steps: int,
    size: int = 8,
    rate: float = 4e-3,
    seed: int = 0,
    keep: Callable[[StreetNet], None] | None = None,
) -> tuple[StreetNet, list[float]]:
    """Train a network.

    Parameters
    ----------
    samples : frames with truth
    steps : number of updates
    size : crops per update
    rate : largest learning rate (AdamW, one cycle)
    seed : decides weights and crops
    keep : called with the averaged network every 500 steps

    Returns
    -------
    The network with the moving average of its weights, and the loss of every step.
    """
    torch.manual_seed(seed)
    net = StreetNet().train()
    average = copy.deepcopy(net)
    optimizer = torch.optim.AdamW(net.parameters(), rate, weight_decay=1e-3)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, rate, total_steps=steps, pct_start=0.15)
    losses = []
    with ThreadPoolExecutor(1) as loader, progress("training", steps) as advance:
        coming = loader.submit(batch, samples, size, np.random.default_rng([seed, 0]))
        for step in range(steps):
            frames, backgrounds, targets = coming.result()
            coming = loader.submit(batch, samples, size, np.random.default_rng([seed, step + 1]))
            # half precision is twice as fast where the processor has it; the last quarter settles in single
            with torch.autocast("cpu", torch.bfloat16, enabled=step < 0.75 * steps):
                maps = net(*(p.contiguous(memory_format=torch.channels_last) for p in (frames, backgrounds)))
            loss = detection_loss(maps.float(), targets)
            optimizer.zero_grad(set_to_none=True)
            loss.backward()
            nn.utils.clip_grad_norm_(net.parameters(), 10.0)
            optimizer.step()
            schedule.step()
            blend(average, net, min(0.998, (step + 1) / (step + 10)))
            losses.append(loss.item())
            if step % 50 == 49:
                logger.debug("step %d loss %.3f", step + 1, np.mean(losses[-50:]))
            if keep and step % 500 == 499:
                keep(copy.deepcopy(average).eval())
            advance(1)
    return average.eval(), losses


@torch.no_grad()
def blend(average: nn.Module, net: nn.Module, keep: float) -> None:
    """Move the average's weights and statistics toward the network's by 1 - `keep`."""
    for mean, new in zip(average.state_dict().values(), net.state_dict().values(), strict=True):
        if mean.dtype.is_floating_point:
            mean.lerp_(new, 1 - keep)


def main() -> None:
    """Render, train, score and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, help="ONNX file to write")
    parser.add_argument("--cache", type=Path, default=Path("street_scenes"), help="folder for rendered scenes")
    parser.add_argument("--scenes", type=int, default=240, help="streets to train on, 16 frames each")
    parser.add_argument("--held-out", type=int, default=40, help="streets to score on, 8 frames each")
    parser.add_argument("--steps", type=int, default=8000)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args()
    logging.basicConfig(format="%(asctime)s %(message)s", level=logging.DEBUG)
    torch.set_num_threads(chosen.threads)
    cv2.setNumThreads(chosen.threads)
    samples = make_samples(range(chosen.scenes), 16, chosen.cache)

    def keep(net: StreetNet) -> None:
        save_onnx(net, chosen.out, THRESHOLD)

    net, _ = train(samples, chosen.steps, seed=chosen.seed, keep=keep)
    keep(net)
    held_out = make_samples(range(HELD_OUT, HELD_OUT + chosen.held_out), 8, chosen.cache)
    print(score(onnx_detector(chosen.out), held_out, THRESHOLD).lines())


if __name__ == "__main__":
    main()
