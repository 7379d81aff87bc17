"""Model criticism: is the noise known, where does the model fail, which effect is missing, what does adding it do."""
