"""Motion as bodies in 3D in the browser: what to draw is computed here without a viewer, `page` alone knows viser."""
from style_core.view.figure import Figure, figure_of
from style_core.view.ground import Contact, contacts_of, walked

__all__ = ['Contact', 'Figure', 'contacts_of', 'figure_of', 'walked']
