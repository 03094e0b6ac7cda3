"""Datasets of shots: a directory of rig.toml, shots, tracks and traces <-> columns."""

from sim.dataset.load import dataset_hash, hash_dataset, load_dataset
from sim.dataset.model import Dataset, Shots, Traces, Tracks
from sim.dataset.parts import join_datasets, take_shots
from sim.dataset.rig import load_rig, save_rig
from sim.dataset.save import check_free, save_dataset

__all__ = ["Dataset", "Shots", "Traces", "Tracks", "check_free", "dataset_hash", "hash_dataset",
           "join_datasets", "load_dataset", "load_rig", "save_dataset", "save_rig", "take_shots"]
