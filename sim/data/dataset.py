"""Datasets of shots: a directory of rig.toml, shots, tracks and traces <-> columns."""

from truearc.sim.data.frames import dataset
from truearc.sim.data.load import hash_dataset, load_dataset
from truearc.sim.data.model import Dataset, Shots, Times, Traces, Tracks, join_datasets
from truearc.sim.data.rig import load_rig, save_rig
from truearc.sim.data.save import check_free, save_dataset

__all__ = ["Dataset", "Shots", "Times", "Traces", "Tracks", "check_free", "dataset", "hash_dataset", "join_datasets",
           "load_dataset", "load_rig", "save_dataset", "save_rig"]
