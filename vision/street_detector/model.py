"""The network: a frame beside its background in, vehicles out."""

import torch
from torch import Tensor, nn

CLASSES = ("car", "van", "truck", "bus")
STRIDE = 4  # px of the input per cell of the output
INPUT = (384, 640)  # rows and columns of the exported input
KEPT = 100  # detections per frame


class Residual(nn.Module):
    """Two 3 x 3 convolutions beside the identity (He et al. 2016)."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.body = nn.Sequential(
            convolution(channels, channels),
            nn.Conv2d(channels, channels, 3, 1, 1, bias=False),
            nn.BatchNorm2d(channels),
        )

    def forward(self, x: Tensor) -> Tensor:
        """Map [batch, channel, row, column] to the same shape."""
        return torch.relu(x + self.body(x))


def convolution(inputs: int, outputs: int, size: int = 3, stride: int = 1) -> nn.Sequential:
    """Return a convolution with batch normalization and ReLU."""
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, size, stride, size // 2, bias=False), nn.BatchNorm2d(outputs), nn.ReLU(inplace=True)
    )


class StreetNet(nn.Module):
    """Centers, box sides and classes of vehicles on a grid of `STRIDE` px.

    A small residual pyramid with one map at the finest level; the heads follow Zhou et al. (2019, CenterNet: heat map
    of centers) and Tian et al. (2019, FCOS: distances from a cell to the box's four sides).
    """

    def __init__(self, widths: tuple[int, int, int, int, int] = (12, 16, 32, 64, 96)) -> None:
        super().__init__()
        w2, w4, w8, w16, w32 = widths
        self.to4 = nn.Sequential(convolution(6, w2, stride=2), convolution(w2, w4, stride=2), Residual(w4))
        self.to8 = nn.Sequential(convolution(w4, w8, stride=2), Residual(w8))
        self.to16 = nn.Sequential(convolution(w8, w16, stride=2), Residual(w16))
        self.to32 = nn.Sequential(convolution(w16, w32, stride=2), Residual(w32), Residual(w32))
        self.lateral16 = convolution(w32, w16, size=1)
        self.lateral8 = convolution(w16, w8, size=1)
        self.lateral4 = convolution(w8, w4, size=1)
        self.smooth16, self.smooth8 = convolution(w16, w16), convolution(w8, w8)
        self.smooth4 = nn.Sequential(convolution(w4, w4), convolution(w4, w8))
        self.heads = nn.Conv2d(w8, 1 + 4 + len(CLASSES), 1)
        with torch.no_grad():
            start = torch.tensor([-4.0] + [1.5] * 4 + [0.0] * len(CLASSES))  # centers are rare, sides a few cells
            self.heads.bias = nn.Parameter(start)

    def forward(self, frame: Tensor, background: Tensor) -> Tensor:
        """Frame and background [batch, 3, row, column], RGB, 0-1 -> [batch, 9, row / 4, column / 4].

        Channels: logit of a center; logarithm of the distance to the left, top, right and bottom side in cells;
        logits of the classes.
        """
        f4 = self.to4(torch.cat([2 * frame - 1, 4 * (frame - background)], dim=1))
        f8 = self.to8(f4)
        f16 = self.to16(f8)
        up = self.lateral16(self.to32(f16))
        f16 = self.smooth16(f16 + nn.functional.interpolate(up, scale_factor=2.0, mode="nearest"))
        f8 = self.smooth8(f8 + nn.functional.interpolate(self.lateral8(f16), scale_factor=2.0, mode="nearest"))
        f4 = self.smooth4(f4 + nn.functional.interpolate(self.lateral4(f8), scale_factor=2.0, mode="nearest"))
        return self.heads(f4)


def sides_to_boxes(sides: Tensor) -> Tensor:
    """Log distances [batch, 4, row, column] in cells -> boxes x1, y1, x2, y2 [batch, 4, row, column], px."""
    rows, columns = sides.shape[-2:]
    y, x = torch.meshgrid(
        torch.arange(rows, device=sides.device) + 0.5, torch.arange(columns, device=sides.device) + 0.5, indexing="ij"
    )
    left, top, right, bottom = torch.exp(sides.clamp(-4.0, 5.0)).unbind(1)
    return STRIDE * torch.stack([x - left, y - top, x + right, y + bottom], dim=1)


class Decoded(nn.Module):
    """The network with peak extraction: what the ONNX file holds."""

    def __init__(self, net: StreetNet) -> None:
        super().__init__()
        self.net = net

    def forward(self, frame: Tensor, background: Tensor) -> Tensor:
        """Frame and background [1, 3, row, column] -> [1, KEPT, 6]: x1, y1, x2, y2 (px), score, class."""
        maps = self.net(frame, background)
        heat = torch.sigmoid(maps[:, :1])
        # a cell is a detection where no neighbor is hotter
        peaks = heat * (heat == nn.functional.max_pool2d(heat, 5, 1, 2)).to(heat.dtype)
        scores, cells = torch.topk(peaks.flatten(1), KEPT)
        boxes = sides_to_boxes(maps[:, 1:5]).flatten(2)
        kinds = maps[:, 5:].flatten(2).argmax(1).to(heat.dtype)
        rows = [*boxes.unbind(1), kinds]
        x1, y1, x2, y2, kind = (torch.gather(row, 1, cells) for row in rows)
        return torch.stack([x1, y1, x2, y2, scores, kind], dim=2)
