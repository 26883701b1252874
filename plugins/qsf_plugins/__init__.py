"""The built-in physics of qsframework: one file per effect, written against `qsframework.plugin` only."""
