"""MJCF, the native format of MuJoCo: `reading` goes through its compiler, `writing` needs no MuJoCo."""
