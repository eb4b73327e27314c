"""The catalogue of manufactured solutions, one YAML file each; README.md says how to add one."""
