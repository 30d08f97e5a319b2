"""The controller that is stable by design: any task, objective and constraints."""
