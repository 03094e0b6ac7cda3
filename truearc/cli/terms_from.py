"""The option --terms-from: hypotheses of the user's own, beside the catalogue's."""

import argparse
from typing import TYPE_CHECKING

if TYPE_CHECKING:                     # JAX, for nothing that --help needs
    from truearc.sim.physics.catalogue import Catalogue


def add_terms_from(parser: argparse.ArgumentParser) -> None:
    """Add the option to a command that names terms."""
    parser.add_argument("--terms-from", metavar="FILE.py", action="append",
                        help="Python file that defines further terms (docs/terms.md); may be given more than once")


def catalogue_of(args: argparse.Namespace) -> "Catalogue":
    """The built-in terms, those of installed distributions, and those of the files that --terms-from names.

    Raises:
        InputError: names the file or distribution whose terms cannot be loaded, are incomplete, or have a taken name.
    """
    from truearc.sim.physics.catalogue import Catalogue, catalogue
    from truearc.sim.physics.plugins import terms_of_file
    known = catalogue()
    for path in args.terms_from or ():
        known = Catalogue((*known, *terms_of_file(path, known)))
    return known
