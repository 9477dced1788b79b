"""Commands of ``ema``, one module each."""
