"""Policies as layers: one definition that NumPy, torch, C and ONNX read."""
