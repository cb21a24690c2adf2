"""The terms of a report, a sentence each. The page links each term to its line where it first stands."""

TERMS = {
    "contestant": "An engine with its settings, on one scene. Its name has those settings that differ within the experiment: "
    "accelerator (how the hit of a ray is found: bvh, grid, brute force), sampler, precision and threads.",
    "target": "The error that a contestant has to reach. The time until then is compared.",
    "reference": "An image at many samples that is taken as the truth; errors are differences from it.",
    "relMSE": "Mean of (A - R)² / (R² + ε) over pixels and channels, for an image A and the reference R.",
    "noise-corrected": "The expectation of the error does not contain the noise of the reference.",
    "warm, cold": "Warm time is rendering alone. Cold time adds import, scene load, build and compilation.",
    "block": "Every cell of the experiment once, in random order, under one seed. Blocks are the repetitions.",
    "cell": "One contestant on one scene under one seed.",
    "interval": "The range in square brackets: it covers the true value in 95 % of repetitions.",
    "fastest": "The only contestant that no test finds slower than another. Tests of a scene and target are corrected for "
    "their number.",
    "not separated": "Several contestants may be the fastest; the data do not show which.",
    "ratio": "Time of one contestant over that of another to the same target, paired by block: above 1 the first named is "
    "faster. Every contestant has one to its baseline.",
    "no ratio": "The contestant is alone in its race, or its baseline, and no other reached the target; or it or its baseline "
    "has a flag that disqualifies it. The cell says which.",
    "baseline": "The contestant that the times of others are compared with: the one that has the first value of every axis, as "
    "the config writes them, or the one that it names.",
    "image baseline": "The contestant that the image of another is compared with: the most similar one of one engine, "
    "that of the config's baseline, else numpy, numba or embree.",
    "persistent spread": "By how much two equal contestants differ in all blocks alike, found from A/A twins: a standard "
    "deviation, by which the intervals of ratios, not of seconds, are widened.",
    "A/A twin": "A second name under which a contestant is measured again.",
    "contended": "Of a timing: other work took the processor for more than 5 % of the time.",
    "calibration": "A test of the verdicts on synthetic contestants of known truth, which have the noise of this run.",
    "certified": "Of a reference: an engine with other code (another lineage) makes the same image within the margins.",
    "flagged": "The image, the error or the conduct of the contestant is in doubt. It is not ranked in its division.",
    "bias": "Difference of the expected image and the reference. It remains however many samples are taken.",
    "Welch's test": "Of two means whose variances differ. Its p value is the probability of a difference as large as the one "
    "that was seen, if there is none.",
    "equivalent": "A positive verdict: bounds on the difference of two images lie within margins that were set beforehand.",
    "spp": "Samples per pixel.",
    "checkpoint": "A number of samples at which the error is measured.",
    "slope": "Exponent by which the RMSE falls with the samples: -0.5 is that of Monte Carlo.",
    "Pareto front": "Checkpoints that no other one beats in both time and error.",
    "division": "Closed: the same estimator makes the same image. Open: any method that reaches the target without bias.",
}


def anchor(term: str) -> str:
    """The id of a term's line."""
    return "term-" + "".join(letter if letter.isalnum() else "-" for letter in term.lower())
