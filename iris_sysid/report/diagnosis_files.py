"""The names of the output files of a diagnosis, which can be checked before matplotlib is loaded."""

FILES = (
    "diagnosis.json",
    "components.png",
    "residual.png",
    "state.png",
    "plan.json",
    "plan.png",
    "report.html",
)
