"""Scene files that name a file outside their folder: one for every way in which Blender's
importers, and a .blend, can.
"""

import json
import shutil
import struct
import wave
from pathlib import Path

import own_scene_files as made

TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 0 1\nvt 0 0\nvt 1 0\nvt 0 1\n"
PLY = "ply\nformat ascii 1.0\nelement vertex 3\n"
PLY += "property float x\nproperty float y\nproperty float z\nelement face 1\n"
PLY += "property list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
USD_MESH = 'def Mesh "M" { int[] faceVertexCounts = [3]; int[] faceVertexIndices = [0,1,2]; '
USD_MESH += "point3f[] points = [(0,0,0),(1,0,0),(0,1,0)];"


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
            made.fresh(self.bpy)
            made.picture(self.bpy, path)
        elif kind == "blend":
            made.fresh(self.bpy)
            made.box(self.bpy, "lent", (0, 0, 0), (1, 1, 1))
            self.bpy.ops.wm.save_as_mainfile(filepath=str(path))
        elif kind == "wav":
            with wave.open(str(path), "wb") as sound:
                sound.setparams((1, 2, 8000, 0, "NONE", ""))
                sound.writeframes(bytes(1600))
        else:
            contents = {
                "obj": TRIANGLE + "f 1 2 3\n",
                "ply": PLY,
                "csv": "a,b\n1,2\n",
                "txt": "text",
            }
            contents |= {
                "usda": f'#usda 1.0\n(defaultPrim = "M")\n{USD_MESH} }}\n',
                "mtl": "newmtl m\nKd 1 0 0\n",
            }
            contents |= {
                "ies": "IESNA:LM-63-2002\nTILT=NONE\n1 1000 1 2 1 1 2 0 0 0\n"
                "1 1 100\n0 90\n0\n100 0\n"
            }
            contents |= {
                "stl": "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\n"
                "vertex 0 1 0\nendloop\nendfacet\nendsolid\n"
            }
            write(path, contents.get(kind, "secret"))
        return path

    def up(self, kind: str) -> str:
        """The way there from the scene's folder."""
        return f"../../outside/{self.secret(kind).name}"

    def save(self, **options) -> Path:
        path = self.inside / "scene.blend"
        self.bpy.ops.wm.save_as_mainfile(filepath=str(path), relative_remap=False, **options)
        return path


def gltf(maker, image=None, buffer=None, glb=False, suffix=None):
    data = struct.pack("<9f6f3H", 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 1, 0, 1, 2)
    write(maker.inside / "own.bin", data)
    views = []
    for o, n in ((0, 36), (36, 24), (60, 6)):
        views.append({"buffer": 0, "byteOffset": o, "byteLength": n})
    kinds = ((5126, "VEC3"), (5126, "VEC2"), (5123, "SCALAR"))
    accessors = []
    for k, (c, t) in enumerate(kinds):
        accessors.append({"bufferView": k, "componentType": c, "count": 3, "type": t})
    accessors[0] |= {"min": [0, 0, 0], "max": [1, 1, 0]}
    if buffer:
        (maker.outside / f"{maker.way}.bin").write_bytes(data)
    attributes = {"POSITION": 0, "TEXCOORD_0": 1}
    texture = {"baseColorTexture": {"index": 0}}
    content = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "bufferViews": views,
        "buffers": [{"uri": buffer or "own.bin", "byteLength": 66}],
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


def usd(maker, head="", body="", before="", name="scene.usda"):
    text = f"#usda 1.0\n({head})\n{before}\n{USD_MESH} {body} }}\n"
    return write(maker.inside / name, text.replace(" }", "\n}"))


def usd_textured(maker, picture):
    body = "rel material:binding = </T>; texCoord2f[] primvars:st = [(0,0),(1,0),(0,1)] "
    body += '(interpolation = "vertex")'
    before = f"""def Material "T" {{ token outputs:surface.connect = </T/S.outputs:surface>;
    def Shader "S" {{ uniform token info:id = "UsdPreviewSurface"; \
color3f inputs:diffuseColor.connect = </T/P.outputs:rgb>;
        token outputs:surface }}
    def Shader "P" {{ uniform token info:id = "UsdUVTexture"; \
asset inputs:file = @{picture}@; float3 outputs:rgb }} }}"""
    return usd(maker, body=body, before=before)


def usdz(maker):
    """A package whose inner layer names a file by its full path."""
    import zipfile

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


def usdc(maker):
    """The binary form of a layer that references one outside."""
    source = usd(maker, body="", before=f'def "R" (references = @{maker.up("usda")}@) {{}}')
    maker.bpy.utils.expose_bundled_modules()
    from pxr import Sdf

    Sdf.Layer.FindOrOpen(str(source)).Export(str(maker.inside / "scene.usdc"))
    source.unlink()
    return maker.inside / "scene.usdc"


def fbx(maker):
    secret = maker.secret("png")
    made.fresh(maker.bpy)
    image = maker.bpy.data.images.load(str(secret))
    made.box(maker.bpy, "box", (0, 0, 0), (1, 1, 1), made.material(maker.bpy, "m", image=image))
    path = maker.inside / "scene.fbx"
    maker.bpy.ops.export_scene.fbx(filepath=str(path), path_mode="ABSOLUTE", bake_anim=False)
    return path


def blend(add, kind=None, link=None, **options):
    """A .blend with a box; `add(bpy, box, path)` makes the datablock that names the file."""

    def make(maker):
        secret = maker.secret(kind) if kind else maker.outside
        bpy = maker.bpy
        scene = made.fresh(maker.bpy)
        box = made.box(bpy, "box", (0, 0, 0), (1, 1, 1), made.material(bpy, "m"))
        scene.world = bpy.data.worlds.new("world")
        name = f"//../../outside/{secret.name}" if kind else None
        if link:
            name = "//" + link(maker.inside, secret).name
        add(bpy, box, name if name else maker)
        return maker.save(**options)

    return make


def _image(bpy, box, name, source="FILE", **user):
    image = bpy.data.images.new("picture", 4, 4)
    image.source = source
    image.filepath = name
    tree = box.data.materials[0].node_tree
    node = tree.nodes.new("ShaderNodeTexImage")
    node.image = image
    for key, value in user.items():
        setattr(node.image_user, key, value)
    tree.links.new(node.outputs[0], tree.nodes["Principled BSDF"].inputs["Base Color"])


def _library(bpy, box, name):
    with bpy.data.libraries.load(name, link=True) as (there, here):
        here.objects = there.objects
    bpy.context.scene.collection.objects.link(here.objects[0])


def _linked(bpy, box, maker):
    secret = maker.secret("blend")
    made.fresh(bpy)
    made.box(bpy, "box", (0, 0, 0), (1, 1, 1))
    maker.save()
    _library(bpy, None, str(secret))
    bpy.data.libraries[0].filepath = f"//../../outside/{secret.name}"


def _through_a_library(bpy, box, maker):
    """The scene links a file of its own folder, which names the picture outside."""
    secret = maker.secret("png")
    made.fresh(bpy)
    inner = made.box(bpy, "inner", (0, 0, 0), (1, 1, 1), made.material(bpy, "m"))
    _image(bpy, inner, f"//../../outside/{secret.name}")
    library = maker.inside / "library.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(library), relative_remap=False)
    made.fresh(bpy)
    maker.save()
    _library(bpy, None, str(library))
    bpy.data.libraries[0].filepath = "//library.blend"


def _loaded(collection, user):
    """A datablock that is loaded from the file itself, and then named relative to the scene."""

    def add(bpy, box, maker, kind):
        secret = (
            maker.secret(kind)
            if kind != "ttf"
            else Path(shutil.copy(font(bpy), maker.outside / f"{maker.way}.ttf"))
        )
        scene = made.fresh(bpy)
        box = made.box(bpy, "box", (0, 0, 0), (1, 1, 1), made.material(bpy, "m"))
        scene.world = bpy.data.worlds.new("world")
        block = getattr(bpy.data, collection).load(str(secret))
        block.filepath = f"//../../outside/{secret.name}"
        user(bpy, box, block)

    return add


def font(bpy) -> Path:
    return next(Path(bpy.utils.resource_path("LOCAL")).rglob("*.ttf"), None) or next(
        Path(bpy.utils.resource_path("LOCAL")).rglob("*.woff2")
    )


def loaded(collection, kind, user):
    return lambda maker: (_loaded(collection, user)(maker.bpy, None, maker, kind), maker.save())[1]


def _speaker(bpy, box, sound):
    speaker = bpy.data.objects.new("speaker", bpy.data.speakers.new("speaker"))
    speaker.data.sound = sound
    bpy.context.scene.collection.objects.link(speaker)


def _text(bpy, box, block):
    curve = bpy.data.curves.new("text", "FONT")
    curve.body = "abc"
    curve.font = block
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("text", curve))


def _background(bpy, box, clip):
    constraint = box.constraints.new("CAMERA_SOLVER")
    constraint.use_active_clip = False
    constraint.clip = clip


def _volume(bpy, box, name):
    volume = bpy.data.volumes.new("volume")
    volume.filepath = name
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("volume", volume))


def _mesh_cache(bpy, box, name):
    modifier = box.modifiers.new("cache", "MESH_CACHE")
    modifier.cache_format = "PC2"
    modifier.filepath = name


def _sequence_cache(bpy, box, name):
    bpy.ops.cachefile.open(filepath=name)
    modifier = box.modifiers.new("cache", "MESH_SEQUENCE_CACHE")
    modifier.cache_file = bpy.data.cache_files[0]
    modifier.object_path = "/M"


def _import_node(node, computed=False):
    def add(bpy, box, name):
        tree = bpy.data.node_groups.new("nodes", "GeometryNodeTree")
        tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
        reads = tree.nodes.new(f"GeometryNodeImport{node}")
        out = tree.nodes.new("NodeGroupOutput")
        if computed:
            join = tree.nodes.new("GeometryNodeStringJoin")
            for part in reversed((name[:-9], name[-9:])):
                text = tree.nodes.new("FunctionNodeInputString")
                text.string = part
                tree.links.new(text.outputs[0], join.inputs["Strings"])
            tree.links.new(join.outputs[0], reads.inputs[0])
        else:
            reads.inputs[0].default_value = name
        if reads.outputs[0].type == "GEOMETRY":
            tree.links.new(reads.outputs[0], out.inputs[0])
        else:
            curves = tree.nodes.new("GeometryNodeStringToCurves")
            tree.links.new(reads.outputs[0], curves.inputs[0])
            tree.links.new(curves.outputs[0], out.inputs[0])
        box.modifiers.new("nodes", "NODES").node_group = tree

    return add


def _ies(bpy, box, name):
    lamp = made.lamp(bpy).data
    lamp.use_nodes = True
    lamp.node_tree.nodes.clear()
    ies, shine, out = (
        lamp.node_tree.nodes.new(f"ShaderNode{n}") for n in ("TexIES", "Emission", "OutputLight")
    )
    ies.mode = "EXTERNAL"
    ies.filepath = name
    lamp.node_tree.links.new(ies.outputs[0], shine.inputs["Strength"])
    lamp.node_tree.links.new(shine.outputs[0], out.inputs[0])


def _osl(bpy, box, name):
    bpy.context.scene.render.engine = "CYCLES"
    bpy.context.scene.cycles.shading_system = True
    node = box.data.materials[0].node_tree.nodes.new("ShaderNodeScript")
    node.mode = "EXTERNAL"
    node.filepath = name


def _ocean(bpy, box, maker):
    (maker.outside / f"{maker.way}").mkdir()
    write(maker.outside / maker.way / f"disp_0001_{maker.way}.exr", "secret")
    modifier = box.modifiers.new("ocean", "OCEAN")
    modifier.filepath = f"//../../outside/{maker.way}"


def _point_cache(bpy, box, maker):
    folder = maker.outside / f"{maker.way}"
    folder.mkdir()
    modifier = box.modifiers.new("cloth", "CLOTH")
    cache = modifier.point_cache
    cache.use_external = True
    cache.filepath = f"//../../outside/{maker.way}"


def _fluid(bpy, box, maker):
    folder = maker.outside / f"{maker.way}"
    write(
        folder / "config" / "config_0009.uni", "secret"
    )  # the first one, if no cache, ends Blender
    modifier = box.modifiers.new("fluid", "FLUID")
    modifier.fluid_type = "DOMAIN"
    modifier.domain_settings.cache_directory = f"//../../outside/{folder.name}"


def _nodes_bake(bpy, box, maker):
    folder = maker.outside / f"{maker.way}"
    write(folder / "1" / "meta" / f"{maker.way}.json", "secret")
    _import_node("OBJ")(bpy, box, "")
    box.modifiers[0].bake_directory = f"//../../outside/{folder.name}"


def _external_data(bpy, box, maker):
    box.modifiers.new("multires", "MULTIRES")
    with bpy.context.temp_override(object=box, active_object=box):
        bpy.ops.object.multires_subdivide(modifier="multires")
        bpy.ops.object.multires_external_save(
            modifier="multires", filepath=str(maker.outside / f"{maker.way}.btx")
        )


def symlink(name):
    """The scene names a file of its own folder, which is a link to the one outside."""

    def link(inside, secret):
        (inside / name).symlink_to(secret)
        return inside / name

    return link


def _next_frame(inside, secret):
    """The second picture of a sequence leads out."""
    shutil.copy(secret, inside / "frame_0001.png")
    (inside / "frame_0002.png").symlink_to(secret)
    return inside / "frame_0001.png"


def _tile(inside, secret):
    shutil.copy(secret, inside / "tile.1001.png")
    (inside / "tile.1002.png").symlink_to(secret)
    return inside / "tile.<UDIM>.png"


def _inner_obj(inside, secret):
    """An OBJ of the own folder that names materials outside."""
    return write(inside / "inner.obj", f"mtllib ../../outside/{secret.name}\n{TRIANGLE}f 1 2 3\n")


def _inner_usd(inside, secret):
    return write(
        inside / "inner.usda",
        f"#usda 1.0\n(subLayers = [@../../outside/{secret.name}@])\n{USD_MESH} }}\n",
    )


def _playlist(inside, secret):
    return write(
        inside / "film.m3u8",
        f"#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\n{secret}\n#EXT-X-ENDLIST\n",
    )


def _obj_map_of_any_file(m):
    write(m.inside / "own.txt", f"newmtl m\nmap_Kd {m.up('png')}\n")
    return obj(m, "own.txt")


def _obj_like_usd(m):
    return write(obj(m), f"#usda 1.0\nmtllib {m.up('mtl')}\n{TRIANGLE}f 1 2 3\n")


def _gltf_image_percent(m):
    return gltf(m, m.up("png").replace("..", "%2e%2e").replace("/", "%2F"))


def _usd_variant(m):
    inner = f'variantSet "v" = {{ "x" (references = @{m.up("usda")}@) {{}} }}'
    variants = '(variantSets = "v"; variants = { string v = "x" })'
    return usd(m, before=f'def "R" {variants} {{ {inner} }}')


def _usd_expression(m):
    head = 'expressionVariables = { string D = "../.." }'
    path = f'"${{D}}/outside/{m.secret("usda").name}"'
    return usd(m, head=head, before=f'def "R" (references = @`{path}`@) {{}}')


def _usd_inner(m):
    _inner_usd(m.inside, m.secret("usda"))
    return usd(m, head="subLayers = [@./inner.usda@]")


def _usd_dome(m):
    return usd(m, before=f'def DomeLight "L" {{ asset inputs:texture:file = @{m.up("png")}@ }}')


def _usd_volume(m):
    file = f'asset filePath = @{m.up("vdb")}@; token fieldName = "density"'
    field = f'rel field:density = </V/F>; def OpenVDBAsset "F" {{ {file} }}'
    return usd(m, before=f'def Volume "V" {{ {field} }}')


def _usd_clip(m):
    paths = f'asset[] assetPaths = [@{m.up("usda")}@]; string primPath = "/M"'
    times = f"double2[] active = [(0, 0)]; asset manifestAssetPath = @{m.up('usda')}@"
    clips = f"clips = {{ dictionary default = {{ {paths}; {times} }} }}"
    return usd(m, before=f'def "C" ({clips}) {{ float a }}')


def _usd_materialx(m):
    include = f'<xi:include href="{m.up("mtlx")}"/>'
    head = '<materialx version="1.38" xmlns:xi="http://www.w3.org/2001/XInclude">'
    write(m.inside / "look.mtlx", f'<?xml version="1.0"?>\n{head}{include}</materialx>')
    return usd(m, head="subLayers = [@./look.mtlx@]")


def _sequence(b, x, n):
    _image(b, x, n, "SEQUENCE", frame_duration=2, frame_start=0, use_auto_refresh=True)


def _film(b, x, n):
    _image(b, x, n, "MOVIE", frame_duration=2, use_auto_refresh=True)


#: Import nodes of Geometry Nodes, and the endings of what they read.
IMPORTED = {"OBJ": "obj", "PLY": "ply", "STL": "stl", "CSV": "csv", "Text": "txt", "VDB": "vdb"}
#: Name of the way -> the function that writes its scene and returns the file.
WAYS = {
    "gltf_image": lambda m: gltf(m, m.up("png")),
    "gltf_image_backslash": lambda m: gltf(m, m.up("png").replace("/", "\\")),
    "gltf_image_percent": _gltf_image_percent,
    "gltf_image_both": lambda m: gltf(m, m.up("png").replace("/", "%5C")),
    "gltf_image_absolute": lambda m: gltf(m, str(m.secret("png"))),
    "gltf_image_file_url": lambda m: gltf(m, m.secret("png").as_uri()),
    "gltf_image_through_a_file": lambda m: gltf(m, "own.bin/../" + m.up("png")),
    "gltf_image_nul": lambda m: gltf(m, m.up("png") + "\0.png"),
    "gltf_buffer": lambda m: gltf(m, buffer=m.up("bin")),
    "gltf_buffer_data": lambda m: gltf(m, buffer="data:,/../" + m.up("bin")),
    "gltf_image_symlink": lambda m: gltf(m, symlink("own.png")(m.inside, m.secret("png")).name),
    "glb_image": lambda m: gltf(m, m.up("png"), glb=True),
    "glb_named_gltf": lambda m: gltf(m, m.up("png"), glb=True, suffix="gltf"),
    "obj_mtllib": lambda m: obj(m, m.up("mtl")),
    "obj_mtllib_control": lambda m: obj(m, m.up("mtl"), blank="\x0b"),
    "obj_map_control": lambda m: obj(m, line=f"map_Kd\x01{m.up('png')}"),
    "obj_map_return": lambda m: obj(m, line=f"map_Kd\r{m.up('png')}"),
    "obj_mtllib_absolute": lambda m: obj(m, str(m.secret("mtl"))),
    "obj_own_materials": lambda m: (symlink("scene.mtl")(m.inside, m.secret("mtl")), obj(m, ""))[1],
    "obj_map": lambda m: obj(m, line=f"map_Kd {m.up('png')}"),
    "obj_map_options": lambda m: obj(m, line=f"map_Bump -bm 0.5 -o 1 1 1 {m.up('png')}"),
    "obj_map_backslash": lambda m: obj(m, line="map_Ks " + m.up("png").replace("/", "\\")),
    "obj_map_absolute": lambda m: obj(m, line=f"\tMAP_KD {m.secret('png')}"),
    "obj_map_of_any_file": _obj_map_of_any_file,
    "obj_mtllib_goes_on": lambda m: obj(m, "\\\n" + m.up("mtl")),
    "obj_like_usd": _obj_like_usd,
    "obj_map_nul": lambda m: obj(m, line=f"map_Kd {m.up('png')}\0.png"),
    "obj_map_cut": lambda m: obj(m, line=f"map_Kd {cut(m)}"),
    "usd_sublayer": lambda m: usd(m, head=f"subLayers = [@{m.up('usda')}@]"),
    "usd_reference": lambda m: usd(m, before=f'def "R" (references = @{m.up("usda")}@) {{}}'),
    "usd_payload": lambda m: usd(m, before=f'def "R" (payload = @{m.up("usda")}@) {{}}'),
    "usd_variant": _usd_variant,
    "usd_expression": _usd_expression,
    "usd_inner": _usd_inner,
    "usd_texture": lambda m: usd_textured(m, m.up("png")),
    "usd_texture_absolute": lambda m: usd_textured(m, m.secret("png")),
    "usd_dome": _usd_dome,
    "usd_volume": _usd_volume,
    "usd_clip": _usd_clip,
    "usd_materialx": _usd_materialx,
    "usdz_sublayer": usdz,
    "usdc_reference": usdc,
    "fbx_texture": fbx,
    "blend_image": blend(_image, "png"),
    "blend_image_compressed": blend(_image, "png", compress=True),
    "blend_image_symlink": blend(_image, "png", symlink("own.png")),
    "blend_sequence": blend(_sequence, "png", _next_frame),
    "blend_tiles": blend(lambda b, x, n: _image(b, x, n, "TILED"), "png", _tile),
    "blend_playlist": blend(_film, "ts", _playlist),
    "blend_library": blend(_linked),
    "blend_through_a_library": blend(_through_a_library),
    "blend_clip": loaded("movieclips", "png", _background),
    "blend_sound": loaded("sounds", "wav", _speaker),
    "blend_font": loaded("fonts", "ttf", _text),
    "blend_volume": blend(_volume, "vdb"),
    "blend_mesh_cache": blend(_mesh_cache, "pc2"),
    "blend_alembic": blend(_sequence_cache, "abc"),
    "blend_usd_cache": blend(_sequence_cache, "usda"),
    "blend_usd_cache_inner": blend(_sequence_cache, "usda", _inner_usd),
    **{f"blend_nodes_{n.lower()}": blend(_import_node(n), kind) for n, kind in IMPORTED.items()},
    "blend_nodes_obj_inner": blend(_import_node("OBJ"), "mtl", _inner_obj),
    "blend_nodes_computed": blend(_import_node("OBJ", computed=True), "obj"),
    "blend_ies": blend(_ies, "ies"),
    "blend_osl": blend(_osl, "oso"),
    "blend_ocean": blend(_ocean),
    "blend_point_cache": blend(_point_cache),
    "blend_fluid": blend(_fluid),
    "blend_nodes_bake": blend(_nodes_bake),
    "blend_external_data": blend(_external_data),
}
