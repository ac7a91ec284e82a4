"""Initial value problems solved by compiled Dormand-Prince steps, with events and sensitivities."""
