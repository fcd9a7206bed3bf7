#!/usr/bin/env bash
# A study on a SLURM cluster: every array task flies one shard as a plain process.
#   sbatch --array=1-16 deploy/cluster/slurm.sh table2 200
# Join the rows when all tasks are done:
#   alight study merge --out results/all results/shard-*
#SBATCH --job-name=alight-study
#SBATCH --cpus-per-task=4
#SBATCH --mem=2G
#SBATCH --time=01:00:00
set -euo pipefail
study=${1:?usage: sbatch --array=1-N slurm.sh STUDY TRIALS [more flags of alight study]}
trials=${2:?usage: sbatch --array=1-N slurm.sh STUDY TRIALS [more flags of alight study]}
shift 2
exec alight study "$study" --trials "$trials" \
  --shard "${SLURM_ARRAY_TASK_ID}/${SLURM_ARRAY_TASK_COUNT}" \
  --jobs "${SLURM_CPUS_PER_TASK:-1}" \
  --out "results/shard-${SLURM_ARRAY_TASK_ID}" "$@"
