"""Choose twelve poses, measure them in simulation, identify the joint springs, and compare them with the truth."""

import sys
from pathlib import Path

from qsframework.experiment import example, load_experiment, read_plan, simulate, write_plan
from qsframework.fits import identify
from qsframework.plans import design

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "qsf-script")  # its own: nothing of yours is replaced
folder.mkdir(exist_ok=True)
experiment = load_experiment(example("m900ib") / "experiment.yaml")

plan = design(experiment, poses=12, candidates=300, seed=0)
write_plan(folder / "plan.csv", plan, experiment)  # the robot's plan; beside it plan.json with the certificate
assert plan.certificate is not None
bound = 100 * plan.certificate.efficiency  # above 100 where polishing moved poses beyond the candidates
print(f"plan of {len(plan.pose)} poses, {bound:.1f} % of the bound on designs from these candidates")

measured = simulate(experiment, read_plan(folder / "plan.csv", experiment), truth="drawn", seed=1)
fit = identify(experiment, measured.readings)

truth = dict(zip(experiment.model().names, measured.x, strict=True))
for e in fit.estimates:
    off = (e.value - truth[e.name]) / e.sd
    print(f"{e.name}: {1e6 * e.value:.3f} ± {1e6 * e.sd:.3f} urad/(N m), {off:+.1f} sd from the truth")
