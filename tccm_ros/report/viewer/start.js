// Starts the report with the data in the page.

async function start() {
  try {
    const scene = JSON.parse(byId('scene').textContent);
    const arrays = new Arrays(await unpackBlob(byId('arrays').textContent));
    window.tccmReport = new Report(scene, arrays);
  } catch (error) {
    byId('failure').hidden = false;
    byId('failure').textContent = `The 3D view cannot be shown: ${error.message}. `
      + 'Pictures and tables below are complete; a current browser shows the view.';
    console.error(error);
  }
}

start();
