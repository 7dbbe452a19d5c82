"""In which precision the networks multiply matrices, and what a processor is fast at."""

import torch

FLOAT32, BFLOAT16, AUTO = "float32", "bfloat16", "auto"

# Processor features with which PyTorch multiplies bfloat16 about twice as fast as float32; without
# them it emulates, and is slower.
_FAST_BFLOAT16 = ("amx_bf16", "avx512_bf16")


def chosen_precision(setting: str, device: str) -> str:
    """``float32`` or ``bfloat16``: the ``setting`` itself, or what ``auto`` means on this machine.

    ``auto`` asks the processor for its features and measures nothing, so that it means the same at
    every start on one machine. On an accelerator it is float32.
    """
    if setting != AUTO:
        return setting
    features = torch.cpu.get_capabilities() if device == "cpu" else {}
    return BFLOAT16 if any(features.get(name) for name in _FAST_BFLOAT16) else FLOAT32
