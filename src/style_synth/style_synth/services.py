"""The synthesizer's services: style, list of styles, another model."""
from rclpy.callback_groups import ReentrantCallbackGroup

from style_core.errors import ModelError, MotionError, UsageError
from style_core.synthesis.stage import style_bounds
from style_msgs.srv import ListStyles, LoadModel, SetStyle
from style_node.loader import Loader
from style_synth.outputs import style_message

__all__ = ['Services']


class Services:
    """What can be asked of the synthesizer; what is refused says why, and changes nothing.

    Parameters
    ----------
    node : SynthesizerNode
    load : callable
        Model file -> Repertoire.
    """

    def __init__(self, node, load):
        self._node, self._loader = node, Loader(node, load)
        create = node.create_service
        self._served = [
            create(SetStyle, '~/set_style', self._on_set_style),
            create(ListStyles, '~/list_styles', self._on_list_styles),
            # waits for its thread without keeping windows waiting, or the next request
            create(LoadModel, '~/load_model', self._on_load_model, callback_group=ReentrantCallbackGroup())]

    def destroy(self):
        """Take the services down."""
        for one in self._served:
            self._node.destroy_service(one)

    def _on_set_style(self, request, response):
        style, stage = request.style, self._node.stage
        try:
            stage.set_style(style.name if not len(style.values) else style.values, request.transition_time)
            response.success = True
        except UsageError as error:
            response.message = str(error)
        if stage.source is not None:
            response.style = style_message(stage.source, stage.source.target)
        return response

    def _on_list_styles(self, request, response):
        stage = self._node.stage
        response.model, source = stage.repertoire.name, stage.source
        if source is not None and len(source.target):
            response.labels = list(source.labels)
            response.lower, response.upper = (bound.tolist() for bound in style_bounds(source))
            response.styles = [style_message(source, v) for v in source.styles.values()]
            for style, name in zip(response.styles, source.styles):
                style.name = name
        return response

    async def _on_load_model(self, request, response):
        node = self._node
        try:
            loaded = await self._loader.load(request.path)
            if node.stage is None:
                raise UsageError('the node was taken down meanwhile')
            node.stage.replace(loaded)
            node.describe()
            response.success = True
        except (UsageError, ModelError, MotionError, OSError) as error:
            response.message = str(error)
        if node.stage is not None:
            repertoire = node.stage.repertoire
            response.model, response.kind = repertoire.name, repertoire.kind
            response.joint_names = list(repertoire.joint_names)
        return response
