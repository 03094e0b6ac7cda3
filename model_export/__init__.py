"""Trained weights to stamped ONNX files."""
