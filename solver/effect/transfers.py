"""Functions that stages are changed by."""

from collections.abc import Callable

from torch import Tensor

#: Complex transfer of a time filter at the complex frequency s = sigma + i omega, rad/s.
TimeTransfer = Callable[[Tensor], Tensor]


#: Real, even transfer of a filter along the fiber at the wavenumber k, rad/m.
FiberTransfer = Callable[[Tensor], Tensor]


#: Of a map [..., sample, channel].
MapFunction = Callable[[Tensor], Tensor]


#: Value [...] at points of the ground [..., 3], m.
Field = Callable[[Tensor], Tensor]
