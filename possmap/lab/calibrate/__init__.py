"""How wrong a robot's odometry is, from trials whose true end is known (the paper's §3)."""
