"""Jobs in the queue of a SLURM cluster: submitted by sbatch, watched by squeue and sacct.

SLURM's own commands are used, and no library between: what a job makes of SLURM's signals, which
element of an array is which job, and what the queue says of each of them must be in one hand.
"""
