"""Many runs: campaigns, what each effect and each choice changes, the thesis's runs, and what a scene means before it is run."""
