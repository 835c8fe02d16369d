// A weight stack (hagoromo_page/publication/stack_basis.py): functions of the lamp's direction, and the picture made of them.

const stackValues = data.stack && new Float32Array(Uint8Array.from(atob(data.stack.values), (one) => one.charCodeAt(0)).buffer);

function matern(distance, length) {  // order 3/2
  const x = (Math.sqrt(3) * distance) / length;
  return (1 + x) * Math.exp(-x);
}

function stackColumns() {  // display colour of a unit of each component under all lamps, r g b
  const count = data.scales.components, colours = data.scales.channels, made = new Float32Array(12 * stackLayers());
  for (const lamp of state.lamps) {
    const to = direction(lamp), body = lampColours(lamp).body, scale = light(lamp).scale;
    const near = data.stack.directions.map((one) => matern(Math.hypot(one[0] - to[0], one[1] - to[1], one[2] - to[2]), data.stack.length));
    near.push(1);
    for (let j = 0; j < colours; j++) for (let k = 0; k < count; k++) {
      let sum = 0;
      for (let n = 0; n < near.length; n++) sum += near[n] * stackValues[(n * colours + j) * count + k];
      for (let c = 0; c < 3; c++) made[3 * k + c] += scale * sum * body[c][j];
    }
  }
  return made;
}

const stackLayers = () => Math.ceil(data.scales.components / 4);

class StackTile {
  constructor(header, planes) {
    const size = header.width * header.height, layers = stackLayers(), values = new Uint16Array(4 * size * layers).fill(32768);
    Object.assign(this, { level: 0, x: 0, y: 0, width: header.width, height: header.height, stamp: 0, shownAt: 0 });
    for (let k = 0; k < data.scales.components; k++) {
      const one = planes[`c${k}`], start = 4 * size * (k >> 2) + (k & 3);
      for (let i = 0; i < size; i++) values[start + 4 * i] = one[i];
    }
    const shape = interleaved(planes, ["level", "cover", "", "label"], size);
    this.geometry = texture(gl.TEXTURE_2D, gl.RGBA16UI, this.width, this.height, 0, shape, gl.UNSIGNED_SHORT, gl.RGBA_INTEGER);
    this.components = texture(gl.TEXTURE_2D_ARRAY, gl.RGBA16UI, this.width, this.height, layers, values, gl.UNSIGNED_SHORT, gl.RGBA_INTEGER);
    this.target = target(this.width, this.height, true);
  }

  shade() {
    if (this.stamp === stamp) return;
    into(this.target, this.width, this.height);
    gl.useProgram(shade.made);
    gl.uniform4f(shade.at("box"), -1, -1, 1, 1);
    bound(shade, "geometry", 0, gl.TEXTURE_2D, this.geometry);
    bound(shade, "components", 1, gl.TEXTURE_2D_ARRAY, this.components);
    gl.uniform3fv(shade.at("columns"), stackColumns());
    gl.uniform2fv(shade.at("levelRange"), data.scales.level);
    gl.uniform1f(shade.at("exposure"), data.exposure * 2 ** state.stops);
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
    gl.bindTexture(gl.TEXTURE_2D, this.target);
    gl.generateMipmap(gl.TEXTURE_2D);
    this.stamp = stamp;
  }
}
