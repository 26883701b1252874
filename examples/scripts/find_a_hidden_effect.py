"""Find the effect that is hidden in a campaign's readings: its name, its evidence, and what it gains."""

from qsframework import diagnosis_words
from qsframework.diagnoses import diagnose
from qsframework.experiment import example, load_experiment, read_readings

experiment = load_experiment(example("hidden_effect") / "experiment.yaml")
readings = read_readings(experiment.data, experiment)

found = diagnose(experiment, readings, seed=0)
print(diagnosis_words(found))
for cause in found.findings:
    print(f"cause: {cause.name}, p = {cause.p_value:.1g}, alternatives: {[r.name for r in cause.alternatives]}")
    print(f"  physics: {cause.physics}")
    print(f"  look at: {cause.check}")
rms = found.rms
print(
    f"at held-out poses: {1e3 * rms.heldout_identified:.3f} mm without it, {1e3 * rms.heldout_extended:.3f} mm with it"
)
