"""The paper's own method: grid fit, synthetic data, network, training and sweep."""
