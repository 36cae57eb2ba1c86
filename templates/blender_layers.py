"""Build the clip from its layers in Blender's compositor.

    blender --background --python blender.py -- OUTPUT_FOLDER

renders the frames as PNG; without `--background` the nodes are open to edit. Blender 4.2 and newer.
"""

import json
import sys
from pathlib import Path

import bpy

FOLDER = Path(__file__).resolve().parent
LINEAR = "Linear Rec.709"


def load_image(path, is_linear):
    """Open a still, a sequence `NAME/%05d.png`, or a clip."""
    is_sequence = "%05d" in path
    name = path % 0 if is_sequence else path
    image = bpy.data.images.load(str(FOLDER / name))
    if is_sequence:
        image.source = "SEQUENCE"
    elif not name.endswith(".png"):
        image.source = "MOVIE"
    is_still = name.endswith(".png")
    image.colorspace_settings.name = LINEAR if is_linear or is_still else "sRGB"
    image.alpha_mode = "STRAIGHT" if name.endswith(".webm") else "PREMUL"
    return image


class Tree:
    """The compositor's nodes, of Blender 4 and 5."""

    def __init__(self, scene, frame_count):
        self.frame_count = frame_count
        self.is_new = hasattr(scene, "compositing_node_group")
        if self.is_new:
            self.tree = bpy.data.node_groups.new("physgen", "CompositorNodeTree")
            scene.compositing_node_group = self.tree
        else:
            scene.use_nodes = True
            self.tree = scene.node_tree
            self.tree.nodes.clear()

    def image(self, path, is_linear):
        """Add a picture; return its socket."""
        node = self.tree.nodes.new("CompositorNodeImage")
        node.image = load_image(path, is_linear)
        if node.image.source != "FILE":
            node.frame_duration = self.frame_count
            node.frame_start = 1
            node.frame_offset = -1 if node.image.source == "SEQUENCE" else 0
        return node.outputs[0]

    def mix(self, kind, below, above):
        """Add MULTIPLY or ADD of two pictures; return its socket."""
        if self.is_new:
            node = self.tree.nodes.new("ShaderNodeMix")
            node.data_type = "RGBA"
            inputs = [socket for socket in node.inputs if socket.type == "RGBA"]
            factor = next(socket for socket in node.inputs if socket.type == "VALUE")
            output = next(socket for socket in node.outputs if socket.type == "RGBA")
        else:
            node = self.tree.nodes.new("CompositorNodeMixRGB")
            factor, *inputs = node.inputs
            output = node.outputs[0]
        node.blend_type = kind
        factor.default_value = 1.0
        self.tree.links.new(below, inputs[0])
        self.tree.links.new(above, inputs[1])
        return output

    def over(self, below, above):
        """Put a premultiplied picture over another; return its socket."""
        node = self.tree.nodes.new("CompositorNodeAlphaOver")
        colours = [socket for socket in node.inputs if socket.type == "RGBA"]
        self.tree.links.new(below, colours[0])
        self.tree.links.new(above, colours[1])
        return node.outputs[0]

    def show(self, socket):
        """Make a socket the result."""
        if self.is_new:
            self.tree.interface.new_socket(
                "Image", in_out="OUTPUT", socket_type="NodeSocketColor"
            )
            node = self.tree.nodes.new("NodeGroupOutput")
        else:
            node = self.tree.nodes.new("CompositorNodeComposite")
        self.tree.links.new(socket, node.inputs[0])


def build(scene, layers):
    """Build the nodes of all layers."""
    frame_count = len(layers["frames"])
    is_linear = layers["encoding"].startswith("linear")
    tree = Tree(scene, frame_count)
    picture = tree.image(layers["plate"], is_linear)
    picture = tree.mix("MULTIPLY", picture, tree.image(layers["shadow"], is_linear))
    for item in layers["objects"]:
        picture = tree.over(picture, tree.image(item["path"], is_linear))
    picture = tree.mix("MULTIPLY", picture, tree.image(layers["multiply"], is_linear))
    picture = tree.mix("ADD", picture, tree.image(layers["add"], is_linear))
    tree.show(picture)


def set_output(scene, layers, folder):
    """Set size, rate and colours of the frames."""
    render = scene.render
    render.resolution_x, render.resolution_y = layers["size"]
    render.resolution_percentage = 100
    render.fps = max(1, round(layers["fps"]))
    render.fps_base = render.fps / layers["fps"]
    scene.frame_start, scene.frame_end = 1, len(layers["frames"])
    scene.view_settings.view_transform = "Standard"
    scene.view_settings.look = "None"
    render.dither_intensity = 0.0
    render.image_settings.file_format = "PNG"
    render.image_settings.color_mode = "RGB"
    render.filepath = str(folder / "frame-")


def main():
    """Build the nodes, and render if a folder is given."""
    layers = json.loads((FOLDER / "layers.json").read_text(encoding="utf-8"))
    scene = bpy.context.scene
    build(scene, layers)
    arguments = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else []
    output = Path(arguments[0]).resolve() if arguments else FOLDER / "blender"
    set_output(scene, layers, output)
    if bpy.app.background and arguments:
        bpy.ops.render.render(animation=True)


main()
