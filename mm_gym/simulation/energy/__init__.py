"""The energy of a motion and the work that changes it, by kernels of their own."""
