MODULE processes
  PERS tooldata tGun:=[TRUE,[[50,-30,250],[0.9437143641,0.1276794407,-0.1448781254,0.2685358228]],[12,[0,0,100],[1,0,0,0],0,0,0]];
  PERS wobjdata wPart:=[FALSE,TRUE,"",[[900,-400,120],[0.9380860126,0.0499192929,0.0096612762,-0.3426504879]],[[0,0,0],[1,0,0,0]]];
  CONST robtarget p1:=[[461.921,1581.755,1001.355],[0.75767605,0.11931039,0.45452722,0.45287640],[0,0,0,0],[9E+09,9E+09,9E+09,9E+09,9E+09,9E+09]];
  CONST robtarget p2:=[[740.739,1297.947,1080.942],[0.77806622,0.12875378,0.43476188,0.43476146],[0,0,0,0],[9E+09,9E+09,9E+09,9E+09,9E+09,9E+09]];
  CONST robtarget p3:=[[573.671,1384.919,1368.926],[0.76405297,0.18427335,0.44983404,0.42416474],[0,0,0,0],[9E+09,9E+09,9E+09,9E+09,9E+09,9E+09]];
  VAR robtarget found;
  PROC main()
    ArcLStart p1,v100,seam1,weld1\Weave:=weave1,fine,tGun\WObj:=wPart;
    ArcL p2,v100,seam1,weld1,z10,tGun\WObj:=wPart;
    ArcCEnd p3,p1,v100,seam1,weld1,fine,tGun\WObj:=wPart;
    TriggL p2,v100,gunon,z10,tGun\WObj:=wPart;
    SearchL\Stop,di1,found,p3,v20,tGun\WObj:=wPart;
    MoveL found,v20,fine,tGun\WObj:=wPart;
    SpotL p1,v100,spot1,gun1,tGun\WObj:=wPart;
  ENDPROC
ENDMODULE
