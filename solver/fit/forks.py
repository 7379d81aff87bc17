"""Processes of our own: how they are begun on this machine."""

import sys

import torch


def can_fork() -> bool:
    """Whether a forked process can go on computing: not beside the threads of macOS's libraries, nor those of CUDA."""
    return sys.platform == "linux" and not torch.cuda.is_initialized()
