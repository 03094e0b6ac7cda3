"""What others would say of the same worlds: each rival one file with `answer(dataset, believed, seed) -> Claim`."""
