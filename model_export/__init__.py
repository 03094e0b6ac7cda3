"""Export of trained weights to ONNX, and the permitted difference in probability between a graph and its trainer."""

# Sums of eight float32 products behind two sigmoids; a network trained a hundred times longer than the default, with
# weights of 50, differs by 6e-6. More than this is another network, not another rounding.
NETWORK_TOLERANCE = 1e-5
# The graph of a physics gate carries its flights as a polynomial, and export refuses one that is worse than this.
PHYSICS_TOLERANCE = 5e-3
