"""How sure the numbers of a scene are -> what of its motion the photo decides: many draws, each simulated."""
