"""What the terms on pages mean: one list, which every page and the documentation hold."""

from html import escape

TERMS = {
    "survey line": "The line along the road from which places across it are counted: y = 0 of the local frame, whose x "
    "runs along the road, y to the right of it, and z down. site.toml says where it begins and where it points.",
    "pass": "One vehicle that goes by once.",
    "channel": "A place along the fiber whose strain is recorded, counted from the interrogator.",
    "gauge length": "The length of fiber over which strain is averaged into one channel, often 10 m. It is not the "
    "spacing of channels, which is often 1 m.",
    "anchor": "A place of the fiber that is known by other means, such as a manhole or a tap test.",
    "route": "Where the fiber runs, in three dimensions.",
    "corridor": "The band about the route that at any one place should hold the fiber in 95 of 100 surveys like this "
    "one. Places of one survey err together.",
    "sigma": "Standard deviation: the corridor reaches 1.96 of them to either side.",
    "residual": "What was measured less what the model says.",
    "misfit": "Mean square of the residual in units of the noise, chi² per degree of freedom: near the noise floor the "
    "model explains all but noise, above it something is missing.",
    "noise floor": "The misfit that noise alone leaves, which a right model reaches.",
    "effect": "Something physical that acts on the record and that a model may lack, such as a longer gauge or a "
    "layer of the ground.",
    "rung": "One model of the error ladder: the one below it with an effect more.",
    "held out": "Of passes: not fitted, so that they judge the model that others made.",
}


def glossary() -> str:
    """The terms as a part of a page that opens at a click, wherever on the page the reader is."""
    return f'<details class="terms"><summary>Terms</summary>{terms()}</details>'


def terms() -> str:
    """The terms as a list."""
    return f"<dl>{''.join(f'<dt>{escape(name)}</dt><dd>{escape(words)}</dd>' for name, words in TERMS.items())}</dl>"
