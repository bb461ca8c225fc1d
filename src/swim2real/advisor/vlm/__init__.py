"""A vision-language model as an advisor: the question, the reply, and all that can go wrong between them."""
