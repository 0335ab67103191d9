"""Which trials to run next, and when to stop: sequential design of experiments for telling models apart.

look          one look at a campaign: the verdict, whether it is enough, the next block
start         the conditions a campaign starts with
places        where trials can be run, and how well one measures there
explanations  what may still be true, and what it predicts; discrepancy: something else, without a name
block         the next trials; information, reason: what each is expected to tell, and why in words
evidence      what is excluded, at every look; reach: what the whole plan would show
curves        what rivals say of the mean speeds that come next
"""
