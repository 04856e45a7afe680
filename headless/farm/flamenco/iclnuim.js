// SPDX-License-Identifier: GPL-3.0-or-later
// A job type for Flamenco 3. Its tasks are simulations (for other scenes), light, chunks of frames and the data set; each calls `iclnuim task`. See docs/guide/cluster.md.

const JOB_TYPE = {
    label: "ICL-NUIM sequence",
    description: "Frames with exact depth, and a clean and a noisy RGB-D sequence made from them",
    settings: [
        { key: "sequence", type: "string", required: true, default: "living_room/kt2",
          description: "kt0 to kt3 of living_room or office, or a recipe file on shared storage" },
        { key: "frames", type: "string", required: true, default: "0-881",
          description: "Frames of the trajectory, both ends included, such as 0-881 or 0, 30, 60-90" },
        { key: "chunk_size", type: "int32", required: true, default: 120, propargs: { min: 1 }, visible: "submission",
          description: "Number of frames of a task: several minutes of work" },
        { key: "out", type: "string", subtype: "dir_path", required: true,
          description: "Folder on shared storage, for raw/, and with a data set for clean/ and noisy/" },
        { key: "dataset", type: "bool", default: true, label: "Data set",
          description: "Make the sequences from the frames; the frames are removed once both sequences are complete" },
        { key: "light", type: "string", choices: ["auto", "baked", "path"], default: "baked",
          description: "Light map baked once, or full path tracing" },
        { key: "samples", type: "int32", default: 0, propargs: { min: 0 },
          description: "Rays per pixel; 0: the default of the chosen light" },
        { key: "camera", type: "string", default: "640x480", description: "WxH or WxH,FX,FY,CX,CY" },
        { key: "depth_noise", type: "string", default: "released", description: "Noise model of the noisy sequence's depth" },
        { key: "rgb_noise", type: "string", default: "released", description: "Noise model of the noisy sequence's colour" },
        { key: "seed", type: "int32", default: 0, propargs: { min: 0 }, description: "Random seed of Cycles and of the noise" },
        { key: "more_options", type: "string", default: "", visible: "submission",
          description: "Further options of `iclnuim make`, as on its command line" },
        { key: "iclnuim", type: "string", default: "iclnuim", visible: "submission",
          description: "The command on the workers: a name on their PATH, a path, or a variable of the Manager such as {iclnuim}" },
    ],
};

function compileJob(job) {
    const settings = job.settings;
    const light = task(settings, "light", "light", "");
    if (`${settings.sequence} ${settings.more_options}`.match(/--scene|\.json/)) {
        const simulations = task(settings, "simulations", "simulations", "");
        job.addTask(simulations);
        light.addDependency(simulations);
    }
    job.addTask(light);

    const chunks = frameChunker(settings.frames, settings.chunk_size);
    const frames = chunks.map((chunk) => task(settings, `frames-${chunk}`, "frames", chunk));
    for (const one of frames) {
        one.addDependency(light);
        job.addTask(one);
    }

    if (settings.dataset) {
        const dataset = task(settings, "dataset", "dataset", chunks.join(","));
        frames.forEach((one) => dataset.addDependency(one));
        job.addTask(dataset);
    }
    print(`ICL-NUIM: ${settings.sequence}, ${countOf(chunks.join(","))} frames in ${chunks.length} tasks`);
}

// One call of `iclnuim task`. Only Flamenco's command for Blender reads progress from a program's output. Its command line is
// exe, argsBefore, blendfile, args, so the sequence takes the place of the blend file.
function task(settings, name, stage, numbers) {
    const one = author.Task(name, "blender");
    one.addCommand(author.Command("blender-render", {
        exe: settings.iclnuim || "iclnuim",
        exeArgs: "",
        argsBefore: ["task", stage],
        blendfile: settings.sequence,
        args: [...jobOptions(settings), ...(numbers ? ["--numbers", numbers] : []), "--progress", "flamenco"],
    }, numbers ? countOf(numbers) : 0));
    return one;
}

function jobOptions(settings) {
    const options = ["--out", settings.out];
    const given = {
        "--light": settings.light,
        "--camera": settings.camera,
        "--samples": settings.samples || "",
        "--seed": settings.seed || "",
        "--depth-noise": settings.depth_noise,
        "--rgb-noise": settings.rgb_noise,
    };
    for (const [option, value] of Object.entries(given)) {
        if (value) options.push(option, String(value));
    }
    return [...options, ...(settings.more_options ? shellSplit(settings.more_options) : [])];
}

// Number of frames in a text such as "0-24,30": the steps of a task.
function countOf(numbers) {
    return numbers.split(",").reduce((sum, part) => {
        const [first, last] = part.split("-").map(Number);
        return sum + (last === undefined ? 1 : last - first + 1);
    }, 0);
}
