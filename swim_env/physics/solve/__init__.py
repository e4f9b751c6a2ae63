"""The variational integrator: Newton, halving, budget."""
