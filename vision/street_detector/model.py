"""The network: a frame beside its background in, vehicles out."""

import torch
from torch import Tensor, nn

CLASSES = ("car", "van", "truck", "bus")
STRIDE = 4  # px of the input per cell of the output
INPUT = (384, 640)  # rows and columns of the exported input
KEPT = 100  # detections per frame


class Residual(nn.Module):
    """Two 3 x 3 convolutions beside the identity (He et al. 2016)."""

    def __init__(self, channels: int, dilation: int = 1) -> None:
        super().__init__()
        self.body = nn.Sequential(
            convolution(channels, channels),
            nn.Conv2d(channels, channels, 3, 1, dilation, dilation, bias=False),
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

    def __init__(self) -> None:
        super().__init__()
        self.to4 = nn.Sequential(convolution(6, 16, stride=2), convolution(16, 16, stride=2), Residual(16))
        self.to8 = nn.Sequential(convolution(16, 40, stride=2), Residual(40))
        self.to16 = nn.Sequential(convolution(40, 64, stride=2), Residual(64))
        self.to32 = nn.Sequential(convolution(64, 96, stride=2), Residual(96), Residual(96, dilation=2))
        self.lateral16, self.lateral8, self.lateral4 = (
            nn.ModuleList([convolution(fine, merged, size=1), convolution(coarse, merged, size=1)])
            for fine, coarse, merged in ((64, 96, 64), (40, 64, 48), (16, 48, 32))
        )
        self.smooth16, self.smooth8, self.smooth4 = convolution(64, 64), convolution(48, 48), convolution(32, 32)
        self.head16, self.head8, self.head4 = (nn.Conv2d(merged, 1 + 4 + len(CLASSES), 1) for merged in (64, 48, 32))
        with torch.no_grad():
            start = torch.tensor([-4.0] + [1.5] * 4 + [0.0] * len(CLASSES))  # centers are rare, sides a few cells
            self.head4.bias = nn.Parameter(start)

    def forward(self, frame: Tensor, background: Tensor) -> Tensor:
        """Frame and background [batch, 3, row, column], RGB, 0-1 -> [batch, 9, row / 4, column / 4].

        Channels: logit of a center; logarithm of the distance to the left, top, right and bottom side in cells;
        logits of the classes.
        """
        f4 = self.to4(torch.cat([2 * frame - 1, 4 * (frame - background)], dim=1))
        f8 = self.to8(f4)
        f16 = self.to16(f8)
        m16 = self.smooth16(merged(self.lateral16, f16, self.to32(f16)))
        m8 = self.smooth8(merged(self.lateral8, f8, m16))
        m4 = self.smooth4(merged(self.lateral4, f4, m8))
        # every level says what it can: the coarse ones see whole vehicles, the fine one places their sides
        coarse = self.head8(m8) + nn.functional.interpolate(self.head16(m16), scale_factor=2.0, mode="nearest")
        return self.head4(m4) + nn.functional.interpolate(coarse, scale_factor=2.0, mode="nearest")


def merged(lateral: nn.ModuleList, fine: Tensor, coarse: Tensor) -> Tensor:
    """Fine map plus the coarse one at its scale, each through its 1 x 1 convolution (Lin et al. 2017)."""
    return lateral[0](fine) + nn.functional.interpolate(lateral[1](coarse), scale_factor=2.0, mode="nearest")


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
