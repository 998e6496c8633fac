"""Which effect a model lacks: candidates are screened, fitted, told apart, and the next measurement is proposed."""
