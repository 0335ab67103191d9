"""Which trials to run next, and when to stop: sequential design of experiments for model discrimination.

look          one interim analysis of a campaign: the verdict, whether it is enough, the next block
start         the conditions a campaign starts with
places        where trials can be run, and how precise one is there
explanations  candidate models and their predictions; discrepancy: a smooth one in case none of them is right
block         the next trials; information, reason: what each is expected to tell, and why, in words
evidence      what is excluded, validly at every look; reach: what the whole plan could show
curves        mean speeds that the rivals predict for the next block
"""
