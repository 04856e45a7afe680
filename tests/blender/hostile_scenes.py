"""Scene files that name a file outside their folder: one for each kind of name that Blender's
importers, and a .blend, follow.
"""

import json
import shutil
import struct
import zipfile
from pathlib import Path

import own_scene_files as made

TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 0 1\nvt 0 0\nvt 1 0\nvt 0 1\n"
USD_MESH = 'def Mesh "M" { int[] faceVertexCounts = [3]; int[] faceVertexIndices = [0,1,2]; '
USD_MESH += "point3f[] points = [(0,0,0),(1,0,0),(0,1,0)];"
#: What stands in a file outside, by its ending.
CONTENTS = {
    "usda": f'#usda 1.0\n(defaultPrim = "M")\n{USD_MESH} }}\n',
    "mtl": "newmtl m\nKd 1 0 0\n",
    "obj": TRIANGLE + "f 1 2 3\n",
}


def write(path: Path, content: str | bytes) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


class Maker:
    """Files of one way: `inside`, the scene's folder, and `secret(kind)`, a file outside named
    after the way.
    """

    def __init__(self, bpy, root: Path, way: str) -> None:
        self.bpy = bpy
        self.way = way
        self.inside = root / "scenes" / way
        self.outside = root / "outside"
        self.inside.mkdir(parents=True)
        self.outside.mkdir(exist_ok=True)

    def secret(self, kind: str) -> Path:
        path = self.outside / f"{self.way}.{kind}"
        if kind == "png":
            made.picture(self.bpy, path)
        elif kind == "blend":
            made.fresh(self.bpy)
            made.box(self.bpy, "lent", (0, 0, 0), (1, 1, 1))
            self.bpy.ops.wm.save_as_mainfile(filepath=str(path))
        else:
            write(path, CONTENTS.get(kind, "secret"))
        return path

    def up(self, kind: str) -> str:
        """The way there from the scene's folder."""
        return f"../../outside/{self.secret(kind).name}"

    def save(self, **options) -> Path:
        path = self.inside / "scene.blend"
        self.bpy.ops.wm.save_as_mainfile(filepath=str(path), relative_remap=False, **options)
        return path


def gltf(maker, image=None, buffer="own.bin", glb=False, suffix=None):
    data = struct.pack("<9f6f3H", 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 1, 0, 1, 2)
    write(maker.inside / "own.bin", data)
    views = []
    for offset, length in ((0, 36), (36, 24), (60, 6)):
        views.append({"buffer": 0, "byteOffset": offset, "byteLength": length})
    accessors = []
    for k, (number, shape) in enumerate(((5126, "VEC3"), (5126, "VEC2"), (5123, "SCALAR"))):
        accessors.append({"bufferView": k, "componentType": number, "count": 3, "type": shape})
    accessors[0] |= {"min": [0, 0, 0], "max": [1, 1, 0]}
    attributes = {"POSITION": 0, "TEXCOORD_0": 1}
    texture = {"baseColorTexture": {"index": 0}}
    content = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "bufferViews": views,
        "buffers": [{"uri": buffer, "byteLength": 66}],
        "accessors": accessors,
        "meshes": [{"primitives": [{"attributes": attributes, "indices": 2, "material": 0}]}],
        "materials": [{"pbrMetallicRoughness": texture if image else {}}],
        "textures": [{"source": 0}],
        "images": [{"uri": image}] if image else [],
    }
    text = json.dumps(content).encode()
    if glb:
        text += b" " * (-len(text) % 4)
        text = b"glTF" + struct.pack("<III4s", 2, 20 + len(text), len(text), b"JSON") + text
    return write(maker.inside / f"scene.{suffix or ('glb' if glb else 'gltf')}", text)


def obj(maker, mtllib="own.mtl", line="", blank=" "):
    write(maker.inside / "own.mtl", f"newmtl m\nKd 1 1 1\n{line}\n")
    head = f"mtllib{blank}{mtllib}\n" if mtllib else ""
    return write(maker.inside / "scene.obj", head + TRIANGLE + "usemtl m\nf 1/1 2/2 3/3\n")


def cut(maker):
    """So long a name that Blender drops its end."""
    name = maker.up("png")
    room = 1023 - len(f"{maker.inside}/{name}")
    return "./" * (room // 2) + name.replace("/", "//" if room % 2 else "/", 1) + ".not"


def _own_materials(maker):
    """Without a mtllib, the file of the OBJ's name is read."""
    made_link(maker.inside, maker.secret("mtl"), "scene.mtl")
    return obj(maker, "")


def _map_of_any_file(maker):
    write(maker.inside / "own.txt", f"newmtl m\nmap_Kd {maker.up('png')}\n")
    return obj(maker, "own.txt")


def _obj_like_usd(maker):
    return write(obj(maker), f"#usda 1.0\nmtllib {maker.up('mtl')}\n{TRIANGLE}f 1 2 3\n")


def usd(maker, head="", body="", before="", name="scene.usda"):
    text = f"#usda 1.0\n({head})\n{before}\n{USD_MESH} {body} }}\n"
    return write(maker.inside / name, text.replace(" }", "\n}"))


def _usd_texture(maker):
    body = "rel material:binding = </T>; texCoord2f[] primvars:st = [(0,0),(1,0),(0,1)] "
    body += '(interpolation = "vertex")'
    before = f"""def Material "T" {{ token outputs:surface.connect = </T/S.outputs:surface>;
    def Shader "S" {{ uniform token info:id = "UsdPreviewSurface"; \
color3f inputs:diffuseColor.connect = </T/P.outputs:rgb>;
        token outputs:surface }}
    def Shader "P" {{ uniform token info:id = "UsdUVTexture"; \
asset inputs:file = @{maker.up("png")}@; float3 outputs:rgb }} }}"""
    return usd(maker, body=body, before=before)


def _usd_expression(maker):
    head = 'expressionVariables = { string D = "../.." }'
    path = f'"${{D}}/outside/{maker.secret("usda").name}"'
    return usd(maker, head=head, before=f'def "R" (references = @`{path}`@) {{}}')


def _usd_inner(maker):
    _inner_usd(maker.inside, maker.secret("usda"))
    return usd(maker, head="subLayers = [@./inner.usda@]")


def _usd_materialx(maker):
    include = f'<xi:include href="{maker.up("mtlx")}"/>'
    head = '<materialx version="1.38" xmlns:xi="http://www.w3.org/2001/XInclude">'
    write(maker.inside / "look.mtlx", f'<?xml version="1.0"?>\n{head}{include}</materialx>')
    return usd(maker, head="subLayers = [@./look.mtlx@]")


def usdz(maker):
    """A package whose inner layer names a file by its full path."""
    inner = f"#usda 1.0\n(subLayers = [@{maker.secret('usda')}@])\n{USD_MESH} }}\n"
    with zipfile.ZipFile(maker.inside / "scene.usdz", "w") as package:
        for name, text in (
            ("root.usda", "#usda 1.0\n(subLayers = [@./inner.usda@])\n"),
            ("inner.usda", inner),
        ):
            info = zipfile.ZipInfo(name)
            at = package.fp.tell() + 30 + len(name)
            info.extra = b"\x86\x19" + struct.pack("<H", (-(at + 4)) % 64) + bytes((-(at + 4)) % 64)
            package.writestr(info, text)
    return maker.inside / "scene.usdz"


def fbx(maker):
    secret = maker.secret("png")
    made.fresh(maker.bpy)
    image = maker.bpy.data.images.load(str(secret))
    made.box(maker.bpy, "box", (0, 0, 0), (1, 1, 1), made.material(maker.bpy, "m", image=image))
    path = maker.inside / "scene.fbx"
    maker.bpy.ops.export_scene.fbx(filepath=str(path), path_mode="ABSOLUTE", bake_anim=False)
    return path


def blend(add, kind=None, link=None, **options):
    """A .blend with a box; `add(bpy, box, name)` makes the datablock that names the file, in its
    own folder if `link` makes one there. Without a kind, the name is that of a folder.
    """

    def make(maker):
        secret = maker.secret(kind) if kind else maker.outside / maker.way
        if not kind:
            write(secret / "1" / "secret", "secret")
        made.fresh(maker.bpy)
        box = made.box(maker.bpy, "box", (0, 0, 0), (1, 1, 1), made.material(maker.bpy, "m"))
        outside = f"../../outside/{secret.name}"
        add(maker.bpy, box, "//" + (link(maker.inside, secret).name if link else outside))
        return maker.save(**options)

    return make


def image(bpy, box, name, source="FILE"):
    block = bpy.data.images.new("picture", 4, 4)
    block.source = source
    block.filepath = name
    tree = box.data.materials[0].node_tree
    node = tree.nodes.new("ShaderNodeTexImage")
    node.image = block
    tree.links.new(node.outputs[0], tree.nodes["Principled BSDF"].inputs["Base Color"])


def mesh_cache(bpy, box, name):
    modifier = box.modifiers.new("cache", "MESH_CACHE")
    modifier.cache_format = "PC2"
    modifier.filepath = name


def sequence_cache(bpy, box, name):
    bpy.ops.cachefile.open(filepath=name)
    modifier = box.modifiers.new("cache", "MESH_SEQUENCE_CACHE")
    modifier.cache_file = bpy.data.cache_files[0]


def ocean(bpy, box, name):
    box.modifiers.new("ocean", "OCEAN").filepath = name


def point_cache(bpy, box, name):
    cache = box.modifiers.new("cloth", "CLOTH").point_cache
    cache.use_external = True
    cache.filepath = name


def fluid(bpy, box, name):
    modifier = box.modifiers.new("fluid", "FLUID")
    modifier.fluid_type = "DOMAIN"
    modifier.domain_settings.cache_directory = name


def import_node(bpy, box, name, kind="OBJ"):
    """An Import node of Geometry Nodes. Returns it."""
    tree = bpy.data.node_groups.new("nodes", "GeometryNodeTree")
    node = tree.nodes.new(f"GeometryNodeImport{kind}")
    node.inputs[0].default_value = name
    modifier = box.modifiers.new("nodes", "NODES")
    modifier.node_group = tree
    return node


def _computed(bpy, box, name):
    """The path is put together by other nodes."""
    node = import_node(bpy, box, "")
    tree = node.id_data
    join = tree.nodes.new("GeometryNodeStringJoin")
    for part in reversed((name[:-9], name[-9:])):
        text = tree.nodes.new("FunctionNodeInputString")
        text.string = part
        tree.links.new(text.outputs[0], join.inputs["Strings"])
    tree.links.new(join.outputs[0], node.inputs[0])


def _nodes_bake(bpy, box, name):
    import_node(bpy, box, "")
    box.modifiers[0].bake_directory = name


def ies(bpy, box, name):
    lamp = made.lamp(bpy).data
    lamp.use_nodes = True
    node = lamp.node_tree.nodes.new("ShaderNodeTexIES")
    node.mode = "EXTERNAL"
    node.filepath = name


def volume(bpy, box, name):
    block = bpy.data.volumes.new("volume")
    block.filepath = name
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("volume", block))


def _linked(maker):
    _library(maker, maker.secret("blend"), f"//../../outside/{maker.way}.blend")
    return maker.save()


def _through_a_library(maker):
    """The scene links a file of its own folder, which names the picture outside."""
    library = blend(image, "png")(maker).rename(maker.inside / "library.blend")
    _library(maker, library, "//library.blend")
    return maker.save()


def _library(maker, file, name):
    bpy = maker.bpy
    made.fresh(bpy)
    made.box(bpy, "own", (0, 0, 0), (1, 1, 1))
    with bpy.data.libraries.load(str(file), link=True) as (there, here):
        here.objects = there.objects
    bpy.context.scene.collection.objects.link(here.objects[0])
    maker.save()  # in its own folder `//` can be told
    bpy.data.libraries[0].filepath = name


def made_link(inside, secret, name):
    (inside / name).symlink_to(secret)
    return inside / name


def _own_link(inside, secret):
    """The scene names a file of its own folder, which is a link to the one outside."""
    return made_link(inside, secret, "own.png")


def _next_frame(inside, secret):
    """The second picture of a sequence leads out."""
    shutil.copy(secret, inside / "frame_0001.png")
    made_link(inside, secret, "frame_0002.png")
    return inside / "frame_0001.png"


def _tile(inside, secret):
    shutil.copy(secret, inside / "tile.1001.png")
    made_link(inside, secret, "tile.1002.png")
    return inside / "tile.<UDIM>.png"


def _inner_obj(inside, secret):
    """An OBJ of the own folder that names materials outside."""
    return write(inside / "inner.obj", f"mtllib ../../outside/{secret.name}\n{TRIANGLE}f 1 2 3\n")


def _inner_usd(inside, secret):
    layers = f"#usda 1.0\n(subLayers = [@../../outside/{secret.name}@])\n{USD_MESH} }}\n"
    return write(inside / "inner.usda", layers)


def _address(of):
    """A film that FFmpeg would read by another protocol than that of files; `of` makes the address
    of the file outside.
    """

    def film(bpy, box, name):
        image(bpy, box, of(Path(bpy.path.abspath(name))), "MOVIE")

    return blend(film, "ts")


def _playlist(inside, secret):
    head = "#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\n"
    return write(inside / "film.m3u8", f"{head}{secret}\n#EXT-X-ENDLIST\n")


#: Name of the way -> the function that writes its scene and returns the file.
WAYS = {
    "gltf_image": lambda m: gltf(m, m.up("png")),
    "gltf_image_backslash": lambda m: gltf(m, m.up("png").replace("/", "\\")),
    "gltf_image_percent": lambda m: gltf(m, m.up("png").replace("..", "%2e.").replace("/", "%2F")),
    "gltf_image_absolute": lambda m: gltf(m, str(m.secret("png"))),
    "gltf_image_file_url": lambda m: gltf(m, m.secret("png").as_uri()),
    "gltf_image_through_a_file": lambda m: gltf(m, "own.bin/../" + m.up("png")),
    "gltf_image_nul": lambda m: gltf(m, m.up("png") + "\0.png"),
    "gltf_buffer": lambda m: gltf(m, buffer=m.up("bin")),
    "gltf_buffer_data": lambda m: gltf(m, buffer="data:,/../" + m.up("bin")),
    "gltf_image_symlink": lambda m: gltf(m, _own_link(m.inside, m.secret("png")).name),
    "glb_image": lambda m: gltf(m, m.up("png"), glb=True),
    "glb_named_obj": lambda m: gltf(m, m.up("png"), glb=True, suffix="obj"),
    "obj_mtllib": lambda m: obj(m, m.up("mtl")),
    "obj_mtllib_control": lambda m: obj(m, m.up("mtl"), blank="\x0b"),
    "obj_mtllib_goes_on": lambda m: obj(m, "\\\n" + m.up("mtl")),
    "obj_own_materials": _own_materials,
    "obj_map": lambda m: obj(m, line=f"\tMAP_KD {m.up('png')}"),
    "obj_map_control": lambda m: obj(m, line=f"map_Kd\x01{m.up('png')}"),
    "obj_map_options": lambda m: obj(m, line=f"map_Bump -bm 0.5 -o 1 1 1 {m.up('png')}"),
    "obj_map_of_any_file": _map_of_any_file,
    "obj_map_cut": lambda m: obj(m, line=f"map_Kd {cut(m)}"),
    "obj_like_usd": _obj_like_usd,
    "usd_sublayer": lambda m: usd(m, head=f"subLayers = [@{m.up('usda')}@]"),
    "usd_reference": lambda m: usd(m, before=f'def "R" (references = @{m.up("usda")}@) {{}}'),
    "usd_payload": lambda m: usd(m, before=f'def "R" (payload = @{m.up("usda")}@) {{}}'),
    "usd_expression": _usd_expression,
    "usd_inner": _usd_inner,
    "usd_texture": _usd_texture,
    "usd_materialx": _usd_materialx,
    "usdz_sublayer": usdz,
    "fbx_texture": fbx,
    "blend_image": blend(image, "png"),
    "blend_image_compressed": blend(image, "png", compress=True),
    "blend_image_symlink": blend(image, "png", _own_link),
    "blend_sequence": blend(lambda b, x, n: image(b, x, n, "SEQUENCE"), "png", _next_frame),
    "blend_tiles": blend(lambda b, x, n: image(b, x, n, "TILED"), "png", _tile),
    "blend_playlist": blend(lambda b, x, n: image(b, x, n, "MOVIE"), "ts", _playlist),
    "blend_web": _address(lambda secret: f"http://127.0.0.1:9/{secret.name}"),
    "blend_udp": _address(lambda secret: "UDP://127.0.0.1:9?timeout=1"),
    "blend_protocol": _address(lambda secret: f"concat:{secret}"),
    "blend_subfile": _address(lambda secret: f"subfile,,start,0,end,9,,:{secret}"),
    "blend_library": _linked,
    "blend_through_a_library": _through_a_library,
    "blend_mesh_cache": blend(mesh_cache, "pc2"),
    "blend_usd_cache_inner": blend(sequence_cache, "usda", _inner_usd),
    "blend_nodes_obj": blend(import_node, "obj"),
    "blend_nodes_obj_inner": blend(import_node, "mtl", _inner_obj),
    "blend_nodes_computed": blend(_computed, "obj"),
    "blend_point_cache": blend(point_cache),
    "blend_fluid": blend(fluid),
    "blend_nodes_bake": blend(_nodes_bake),
}
