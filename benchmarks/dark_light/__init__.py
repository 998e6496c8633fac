"""How well characterisation finds the dark light of simulated sensors whose truth is known."""
