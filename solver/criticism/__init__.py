"""Model criticism: is the noise understood, where does the model fail, which effect is missing, what does adding it do."""
