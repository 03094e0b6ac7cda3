"""The paper's tables and figures on recordings of the emulated robot, beside baselines and our gate."""
